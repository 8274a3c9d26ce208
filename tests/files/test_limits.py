"""Settings in TOML: what would take gigabytes or minutes is refused before it is parsed, in all that read them."""

import tracemalloc
from time import process_time

import numpy as np
import pytest

from experiments.studies import study_entries
from ident.errors import InputError
from ident.files.limits import TOML_DEPTH, toml
from ident.mechanism.body import Body
from ident.mechanism.tree import Tree
from ident.recordings.columns.mapping import read_mapping
from sim.markers.settings import read_settings

TREE = Tree((Body("arm", -1, np.eye(4), np.array([0, 0, 0, 0, 1, 0.0]), "elbow"),))
READERS = {
    "columns": lambda path: read_mapping(path, TREE),
    "markers": read_settings,
    "study": study_entries.read,
}
KEY = ".".join(["a"] * 20_000)
TEXTS = {
    "dots": f"{KEY} = 1",
    "dots of a table": f"[{KEY}]",
    "dots with spaces": KEY.replace(".", " .\t") + " = 1",
    "quoted names": KEY.replace("a", '"a"') + " = 1",
    "dots in a value": f"x = {{ {KEY} = 1 }}",
    "many keys": "\n".join(f"{KEY[:400]}.b{k} = 1" for k in range(2000)),
    "digits": "x = 0x" + "1" * 10_000_000,
    "digits of a float": "x = 0." + "1" * 500_000,
    "brackets": "x = " + "[" * 15_000,
    "braces": "x = " + "{a=" * 5000,
    "size": "x = [\n" + "1,\n" * 400_000 + "]",
}


@pytest.mark.parametrize("read", READERS.values(), ids=READERS)
def test_settings_that_take_gigabytes_are_one_sentence(tmp_path, read):
    for what, text in TEXTS.items():
        (tmp_path / "c.toml").write_text(text, encoding="utf-8")
        tracemalloc.start()
        begun = process_time()
        try:
            with pytest.raises(InputError, match=r"c\.toml: .* to be TOML in UTF-8") as raised:
                read(tmp_path / "c.toml")
            assert tracemalloc.get_traced_memory()[1] < 20_000_000, what
        finally:
            tracemalloc.stop()
        assert process_time() - begun < 5, what
        assert "\n" not in str(raised.value) and len(str(raised.value)) < 300


def test_settings_within_the_limits_are_read(tmp_path):
    key = ".".join(f"a{k}" for k in range(TOML_DEPTH))
    text = f"{key} = 1\nname = 'observation.state.{'x.' * 10}y'\nrow = [{', '.join(['0.5'] * 3000)}]\n"
    (tmp_path / "c.toml").write_text("\ufeff" + text, encoding="utf-8")
    read = toml(tmp_path / "c.toml", "a study needs")
    assert read["name"].endswith("y") and len(read["row"]) == 3000 and "a1" in read["a0"]
    with pytest.raises(InputError, match=r"absent\.toml: a study needs to be TOML in UTF-8 \(No such file"):
        toml(tmp_path / "absent.toml", "a study needs")
