"""Data classes from tables of entries: one sentence for each thing that can be wrong, with the table's name."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
import pytest

from ident.annotations import NotNegative, Point, Positive, Vector, one_of
from ident.errors import InputError, LogError
from ident.files.schema import made


@dataclass(frozen=True)
class Wheel:
    radius: Positive
    place: Point | None = None

    def __post_init__(self):
        if self.radius > 10:
            raise InputError("needs a smaller radius.")


@dataclass(frozen=True, eq=False)
class Cart:
    name: str
    wheels: tuple[Wheel, ...] = ()
    colour: Annotated[str, one_of(("red", "blue"))] | None = None
    loads: Mapping[str, NotNegative] = field(default_factory=dict)
    middle: Vector | None = None
    matrix: np.ndarray | None = None
    still: bool = False
    seats: int = 2
    file: str = ""
    other: Any = None


GIVEN = {
    "name": "a",
    "wheels": [{"radius": 1}, {"radius": 2.5, "place": [0, 1, 2]}],
    "colour": "red",
    "loads": {"sand": 3},
    "middle": [1, 2, 3],
    "matrix": [[1, 2], [3, 4]],
    "still": True,
    "seats": 4,
    "other": {"x": 1},
}


def test_entries_become_what_the_annotations_say():
    cart = made(Cart, "cart", GIVEN, file="carts.toml")
    assert cart.wheels == (Wheel(1.0), Wheel(2.5, (0.0, 1.0, 2.0))) and type(cart.wheels[0].radius) is float
    assert (cart.name, cart.colour, cart.loads, cart.still, cart.seats) == ("a", "red", {"sand": 3.0}, True, 4)
    assert cart.middle.tolist() == [1, 2, 3] and cart.matrix.dtype == float and cart.matrix.shape == (2, 2)
    assert cart.file == "carts.toml" and cart.other == {"x": 1}
    assert made(Cart, "", {"name": "b"}).wheels == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"nam": "b"}, "[cart] has no entry 'nam'; valid are name, wheels, colour"),
        ({"file": "x"}, "[cart] has no entry 'file'"),
        ({"name": 3}, "cart.name needs a text, got 3."),
        ({"seats": 1.5}, "cart.seats needs a whole number, got 1.5."),
        ({"seats": True}, "cart.seats needs a whole number, got True."),
        ({"still": 1}, "cart.still needs true or false, got 1."),
        ({"colour": "green"}, "cart.colour needs one of red, blue; got green."),
        ({"loads": {"sand": -1}}, "cart.loads.sand needs a number of at least 0, got -1."),
        ({"loads": 3}, "cart.loads needs a mapping of "),
        ({"middle": [1, 2]}, "cart.middle needs a list of 3 numbers, got [1, 2]."),
        ({"middle": [1, 2, "x"]}, "cart.middle needs a list of 3 numbers, got [1, 2, 'x']."),
        ({"matrix": [[1, 2], [3]]}, "cart.matrix needs an array of real numbers, got [[1, 2], [3]]."),
        ({"matrix": [[float("nan")]]}, "cart.matrix needs an array of real numbers, got [[nan]]."),
        ({"wheels": [{}]}, "[cart.wheels 1] needs radius; it has none."),
        ({"wheels": [3]}, "cart.wheels 1 needs a table of entries, got 3."),
        ({"wheels": {"radius": 1}}, "cart.wheels needs a list of "),
        ({"wheels": [{"radius": 0}]}, "cart.wheels 1.radius needs a number above 0, got 0."),
        ({"wheels": [{"radius": 1e9}]}, "cart.wheels 1.radius needs a number above 0, got 1000000000.0."),
        ({"wheels": [{"radius": 11}]}, "[cart.wheels 1] needs a smaller radius."),
        ({"wheels": [{"radius": 1, "place": [1, 2]}]}, "cart.wheels 1.place needs a list of 3 numbers, got [1, 2]."),
    ],
)
def test_what_does_not_fit_is_one_sentence(change, message):
    with pytest.raises(LogError) as refused:
        made(Cart, "cart", {**GIVEN, **change}, file="carts.toml")
    assert str(refused.value).startswith(message) and "\n" not in str(refused.value)
