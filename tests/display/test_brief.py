"""Recordings, mechanisms, regroupings and payloads in a few lines."""

import driven_arm
import pytest

import ident
from ident.display.brief import listed, properties, short


@pytest.mark.parametrize(
    ("thing", "parts"),
    [
        (lambda: driven_arm.log(6.0, 50.0), ["300 at 50 Hz", "turn_position", "bend_torque"]),
        (driven_arm.mechanism, ["column, upper, fore", "turn, lift, bend", "8.5 kg in 3 bodies"]),
        (lambda: ident.find_base_parameters(driven_arm.mechanism()), ["of 30 parameters", "m1 + m2 + m3"]),
    ],
)
def test_a_repr_has_at_most_ten_lines_and_says_the_most_important(thing, parts):
    made = thing()
    lines = repr(made).splitlines()
    assert len(lines) <= 10 and max(map(len, lines)) <= 100
    html = made._repr_html_()
    assert all(part in repr(made) and part in html for part in parts)
    assert lines[0] == f"<{type(made).__name__}" and lines[-1].endswith(">")


def test_long_lists_are_cut_and_empty_properties_left_out():
    assert listed("abc") == "a, b, c" and listed("abcd", 2) == "a, b and 2 more"
    assert short("Thing", {"a": "", "b": None, "c": "x" * 200, "d": 0}) == f"<Thing\n  c: {'x' * 94}…\n  d: 0>"
    assert "<th>a</th><td>&lt;i&gt;</td>" in properties("Thing", {"a": "<i>", "b": ""})
