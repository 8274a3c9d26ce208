"""The faults of `python -m tests.mutants`: their kinds, the draw, and the endings of trials."""

import ast
from dataclasses import replace
from types import SimpleNamespace

import pytest
from mutants import __main__ as command
from mutants import covered, trials
from mutants.drawn import Mutant, drawn, mutants_of

SOURCE = '''"""Text: 1 < 2."""

from typing import TYPE_CHECKING

__all__ = ["limit" + "ed"]
LEAST = 0.5
GUARD = 1e-12

if TYPE_CHECKING:
    x = 1 + 1


@cache(maxsize=3)
def limited(values: tuple[int, 2], way: bool = True, *, low: float = 0.0) -> dict[0, 1]:
    """Words: 3 + 4."""
    if not values and way:
        raise LogError(f"needs {1 + 1} values" + "!")
    out = [x**2 - low for x in tqdm(values, desc="Steps", total=9) if x is not None]
    out[0] = -1
    out = out.reshape(-1)
    if len(out) <= 4 or low >= LEAST:
        print(8)
    return sorted(zip(out, values, strict=True))
'''


def faults(source=SOURCE):
    return [(fault.line, fault.kind, fault.before, fault.after) for fault in mutants_of("room.py", source)]


def test_every_fault_of_a_text_is_found_and_none_in_words_types_and_progress():
    lines = SOURCE.splitlines()
    places = {row: k for k, row in enumerate(lines, 1)}
    line = lambda start: next(k for row, k in places.items() if row.strip().startswith(start))  # noqa: E731
    either = "len(out) <= 4 or low >= LEAST"
    assert sorted(faults()) == sorted(
        [
            (line("LEAST"), "constant", "0.5", "1.0"),
            (line("GUARD"), "constant", "1e-12", "1e-06"),
            (line("def"), "constant", "True", "False"),
            (line("def"), "constant", "0.0", "1.0"),
            (line("if not"), "condition negated", "not values and way", "not (not values and way)"),
            (line("if not"), "and/or", "not values and way", "(not values or way)"),
            (line("if not"), "sign or not dropped", "not values", "(values)"),
            (line("raise"), "statement dropped", lines[line("raise") - 1].strip(), "pass"),
            (line("out = ["), "arithmetic", "x**2 - low", "(x ** 2 + low)"),
            (line("out = ["), "arithmetic", "x**2", "(x * 2)"),
            (line("out = ["), "constant", "2", "3"),
            (line("out = ["), "comparison", "x is not None", "(x is None)"),
            (line("out[0]"), "statement dropped", "out[0] = -1", "pass"),
            (line("out[0]"), "constant", "0", "1"),
            (line("out[0]"), "sign or not dropped", "-1", "(1)"),
            (line("out[0]"), "constant", "1", "2"),
            (line("out = out"), "sign or not dropped", "-1", "(1)"),
            (line("if len"), "condition negated", either, f"not ({either})"),
            (line("if len"), "and/or", either, f"({either.replace('or', 'and')})"),
            # For counts the boundary, for numbers the direction.
            (line("if len"), "comparison", "len(out) <= 4", "(len(out) < 4)"),
            (line("if len"), "constant", "4", "5"),
            (line("if len"), "comparison", "low >= LEAST", "(low <= LEAST)"),
            (line("print"), "statement dropped", "print(8)", "pass"),
            (line("return"), "return dropped", lines[line("return") - 1].strip(), "return None"),
        ]
    )


def test_a_fault_changes_its_place_alone():
    source = SOURCE.replace("Words", "Größe ψ")
    for fault in mutants_of("room.py", source):
        text = fault.applied(source)
        assert ast.dump(ast.parse(text)) != ast.dump(ast.parse(source))
        same = [(a, b) for a, b in zip(text.splitlines(), source.splitlines(), strict=True) if a != b]
        assert len(same) == 1


def test_draws_are_those_of_their_seed_from_different_lines():
    every = mutants_of("room.py", SOURCE)
    assert drawn(every, 5, seed=1) == drawn(every, 5, seed=1) != drawn(every, 5, seed=2)
    lines = [fault.line for fault in drawn(every, 1000, seed=0)]
    assert lines == sorted({fault.line for fault in every})


def test_defaults_are_executed_by_a_functions_lines_and_constants_by_none():
    tree, lines = ast.parse(SOURCE), SOURCE.splitlines()
    first, last = lines.index('    """Words: 3 + 4."""') + 1, len(lines)
    header = next(k for k, row in enumerate(lines, 1) if row.startswith("def"))
    assert covered._body(tree, header) == list(range(first, last + 1))
    assert covered._body(tree, last) == [last]
    assert covered._body(tree, lines.index("LEAST = 0.5") + 1) == []


def test_constants_are_known_by_their_names_in_every_line_of_theirs():
    tree = ast.parse("FIRST, LAST = 0, (\n    1\n)\nSIZES: dict = {\n    'a': 2,\n}\nf(3)\n")
    assert [covered._assigned(tree, line) for line in (1, 2, 5, 7)] == [*[["FIRST", "LAST"]] * 2, ["SIZES"], []]


FAULT = Mutant("ident/room.py", 1, "constant", "2", "3", len("half = lambda x: x / "))


@pytest.mark.parametrize(
    ("test", "ending"),
    [
        ("half(4) == 2", "killed: tests/test_room.py::test_half"),
        ("half(0) == 0", "survived: 1 tests"),
        ("", "survived: no test executes it"),
    ],
)
def test_a_trial_ends_by_what_tests_say_and_leaves_the_copy_as_it_was(tmp_path, test, ending):
    source, tests = "half = lambda x: x / 2\n", ["tests/test_room.py::test_half"] * bool(test)
    for name, text in {
        "ident/__init__.py": "",
        "ident/room.py": source,
        "tests/test_room.py": f"from ident.room import half\n\n\ndef test_half():\n    assert {test}\n",
    }.items():
        (tmp_path / "repository" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "repository" / name).write_text(text, encoding="utf-8")
    copy = trials.copied(tmp_path / "repository", tmp_path / "copy")
    known = SimpleNamespace(tests=lambda path, line: tests.copy(), seconds=dict.fromkeys(tests, 1.0))
    assert trials.trial(copy, known, FAULT, 10.0) == ending
    assert (copy / "ident/room.py").read_text(encoding="utf-8") == source


def test_the_table_lists_survivors_last():
    endings = {0: "survived: 3 tests", 1: "killed: tests/test_room.py::test_half"}
    rows = command.table({0: FAULT, 1: replace(FAULT, line=7)}, endings).splitlines()
    assert rows == [
        "   1 killed    ident/room.py:7  constant: 2 -> 3  (tests/test_room.py::test_half)",
        "   0 survived  ident/room.py:1  constant: 2 -> 3  (3 tests)",
        "Survived: 1 constant",
    ]


@pytest.mark.parametrize("room", ["sim", "ident/nowhere", "ident/model/blocks.c"])
def test_rooms_are_those_of_ident(room, capsys):
    with pytest.raises(SystemExit) as end:
        command.main([room])
    assert end.value.code == 2 and f"got {room}." in capsys.readouterr().err
