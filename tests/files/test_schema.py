"""Data classes from tables of entries: one sentence for each thing that can be wrong, with the table's name."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import date
from time import process_time
from typing import Annotated, Any

import numpy as np
import pytest
from commands import sentence_of

from experiments.studies import study_entries
from ident import InputError
from ident.annotations import NotNegative, Point, Positive, Vector, one_of
from ident.files.atomic import replacing
from ident.files.limits import made
from ident.files.table import Table
from ident.recordings.mapping import read_mapping
from sim.markers.marked_model import read_settings


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


def test_entries_become_what_the_annotations_say():
    wheels = [{"radius": 1}, {"radius": 2.5, "place": [0, 1, 2]}]
    more = {"middle": [1, 2, 3], "matrix": [[1, 2], [3, 4]], "still": True, "seats": 4, "other": {"x": 1}}
    given = {"name": "a", "wheels": wheels, "colour": "red", "loads": {"sand": 3}, **more}
    cart = made(Cart, "cart", given, file="carts.toml")
    assert cart.wheels == (Wheel(1.0), Wheel(2.5, (0.0, 1.0, 2.0))) and type(cart.wheels[0].radius) is float
    assert (cart.name, cart.colour, cart.loads, cart.still, cart.seats) == ("a", "red", {"sand": 3.0}, True, 4)
    assert cart.middle.tolist() == [1, 2, 3] and cart.matrix.dtype == float and cart.matrix.shape == (2, 2)
    assert cart.file == "carts.toml" and cart.other == {"x": 1}
    assert made(Cart, "", {"name": "b"}).wheels == ()


def test_what_does_not_fit_is_one_sentence():
    for change, message in (
        ({"nam": "b"}, "[cart] has no entry 'nam'; valid are name, wheels, colour"),
        ({"file": "x"}, "[cart] has no entry 'file'"),
        ({"name": 3}, "cart.name needs a text, got 3."),
        ({"seats": 1.5}, "cart.seats needs a whole number, got 1.5."),
        ({"seats": True}, "cart.seats needs a whole number, got True."),
        ({"still": 1}, "cart.still needs true or false, got 1."),
        ({"colour": "green"}, "cart.colour needs one of red, blue; got green."),
        ({"loads": {"sand": -1}}, "cart.loads.sand needs a number of at least 0, got -1."),
        ({"loads": 3}, "cart.loads needs a table of entries, got 3."),
        ({"middle": [1, 2]}, "cart.middle needs a list of 3 numbers, got [1, 2]."),
        ({"matrix": [[1, 2], [3]]}, "cart.matrix needs an array of real numbers, got [[1, 2], [3]]."),
        ({"matrix": [[float("nan")]]}, "cart.matrix needs an array of real numbers, got [[nan]]."),
        ({"wheels": [{}]}, "[cart.wheels 1] needs radius; it has none."),
        ({"wheels": [3]}, "cart.wheels 1 needs a table of entries, got 3."),
        ({"wheels": {"radius": 1}}, "cart.wheels needs a list of tables, got {'radius': 1}."),
        ({"wheels": [{"radius": 0}]}, "cart.wheels 1.radius needs a number above 0, got 0."),
        ({"wheels": [{"radius": 1e9}]}, "cart.wheels 1.radius needs a number above 0, got 1000000000.0; numbers have"),
        ({"wheels": [{"radius": date(2026, 1, 2)}]}, "cart.wheels 1.radius needs a number above 0, got "),
        ({"wheels": [{"radius": 11}]}, "[cart.wheels 1] needs a smaller radius."),
    ):
        assert sentence_of(made, Cart, "cart", {"name": "a", **change}, file="carts.toml").startswith(message)


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        ([3, 9, 15], "row 5, column 'x' is empty or NaN, as are 3 of 20 samples of it; a filter"),
        ([3, 9, 10, 11, 15, 16], "as are 6 of 20 samples of it, 3 in a row from row 11 to row 13; a filter"),
    ],
)
def test_the_longest_run_of_missing_samples_is_named(missing, message):
    x = np.arange(20.0)
    x[missing] = np.nan
    table = Table({"x": x}, range(2, 22), "row")
    assert message in sentence_of(table.column, "x")
    np.testing.assert_array_equal(table.column("x", gaps=True), x)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_what_is_no_regular_file_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.csv").mkdir()
    for path in (tmp_path / "pipe.csv", tmp_path / "folder.csv"):
        before, refused = path.stat(), rf"^'{path}' could not be written \(it is no regular file\)"
        with pytest.raises(OSError, match=refused), replacing(path) as temporary:
            assert temporary.suffix == ".csv"
            temporary.write_text("new")
        assert path.stat() == before
    assert len(list(tmp_path.iterdir())) == 2


KEY = ".".join(["a"] * 20_000)
TEXTS = [
    *(f"{KEY} = 1", f"[{KEY}]", KEY.replace(".", " .\t") + " = 1", KEY.replace("a", '"a"') + " = 1"),
    *(f"x = {{ {KEY} = 1 }}", "\n".join(f"{KEY[:399]}.b{k} = 1" for k in range(20))),
    *("x = 0x" + "1" * 10_000_000, "x = 0." + "1" * 20_000, "x = " + "[" * 2000, "x = [\n" + "1,\n" * 400_000 + "]"),
]


@pytest.mark.parametrize("read", [read_settings, study_entries.read, lambda path: read_mapping(path, None)])
def test_settings_that_take_gigabytes_are_one_sentence(tmp_path, read):
    for text in TEXTS:
        (tmp_path / "c.toml").write_text(text, encoding="utf-8")
        begun = process_time()
        sentence = sentence_of(read, tmp_path / "c.toml")
        assert process_time() - begun < 1, text[:80]
        assert "c.toml: " in sentence and " to be TOML in UTF-8" in sentence and len(sentence) < 300
