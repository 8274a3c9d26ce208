"""Symbols in the texts of pages, and texts that only look like symbols."""

import pytest

from experiments.document.symbols import pieces


def shown(text):
    """Text with symbols between dollars and without indices."""
    return "".join(plain + "$" * bool(symbol) + "".join(map("".join, symbol)) for plain, symbol in pieces(text))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("m2rz2 + 0.425 m3", "$m2rz,2 + 0.425 $m3"),
        ("Ixy2 of link1 by +3.2", "$Ixy,2 of link1 by +3.2"),
        ("residuals in Fx, τz (0.1)", "residuals in $Fx, $τz (0.1)"),
        ("offset(Mx)", "offset($Mx)"),
        ("-π/2", "\N{MINUS SIGN}$π/2"),
        ("θ_1", "$θ1"),
        ("m2rz3, m2x, aFx, Fxy, 'Fx', theta, left_hand", "m2rz3, m2x, aFx, Fxy, 'Fx', theta, left_hand"),
        ("theta", "theta"),
        ("", ""),
    ],
)
def test_parameters_and_channels_become_symbols_and_names_stay(text, expected):
    assert shown(text) == expected
