"""The registry: what it holds, and that nothing in it could only be known from the outcome."""

import re
from typing import get_type_hints

import pytest

from experiments.studies.validation.converters import CONVERTERS
from experiments.studies.validation.files import chosen, columns_file, read_entry, registry
from ident.annotations import fits
from ident.errors import InputError
from ident.files.limits import toml

ALLOWED = dict.fromkeys(("gaps", "offsets", "prior"), bool) | dict.fromkeys(("base", "columns"), str)
ALLOWED |= {"fix": dict, "ignore": list, "leave_out": list, "noise": dict}
"""Options that the recording's documentation decides. A choice that only the outcome could suggest is none: a cut-off,
weights, thresholds, knots, priors' sizes, samples to leave out, the estimator or its columns."""

OF_COLUMNS = {"time", "rate", "joints", "motors", "wrenches", "base", "file", "segments"}
"""Tables of an entry's columns file: not `setup`, `known` and `select`."""

NAME = re.compile(r"\w(?:[\w.+ -]{0,98}[\w+-])?", re.ASCII)
REPOSITORY = re.compile(r"\w[\w.-]{0,99}/\w[\w.-]{0,99}", re.ASCII)
ENTRIES = registry().values()


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_every_entry_is_well_formed(entry):
    parts = [entry, entry.source, *entry.files, *entry.published, *filter(None, [entry.reference])]
    assert all(fits(getattr(x, name), hint) for x in parts for name, hint in get_type_hints(type(x)).items())
    assert entry.files and entry.about and entry.title and (entry.tried or entry.note)
    assert REPOSITORY.fullmatch(entry.source.repository)
    assert re.fullmatch(r"([0-9a-f]{7,40})?", entry.source.commit)
    paths = [part.replace(":", "_") for file in entry.files if file.path for part in file.path.split("/")]
    assert all(map(NAME.fullmatch, [*entry.folder.split("/"), *(file.name for file in entry.files), *paths]))
    for file in entry.files:
        assert all(re.fullmatch(r"([0-9a-f]{64})?", each) for each in (file.sha256, file.original))
        assert {file.made, file.converter} <= {"", *CONVERTERS}


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_what_was_tried_has_hashes_and_what_was_not_has_no_numbers(entry):
    assert all(bool(file.sha256) == entry.tried for file in entry.files)
    if entry.tried:
        logs = (*entry.logs, *entry.empty, *entry.loaded)
        used = [*filter(None, [entry.model]), *entry.true_files, *(name for log in logs for name in log)]
        models = {path.name for path in columns_file("", "models").iterdir()}
        assert entry.fitted and set(used) - models <= {file.name for file in entry.files}
    else:
        assert not (entry.published or entry.held_out or entry.reference or entry.alike)
        assert not any(file.original for file in entry.files)


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.name)
def test_options_are_those_that_the_documentation_decides(entry):
    assert all(isinstance(value, ALLOWED[name]) for name, value in entry.options.items())
    if "columns" in entry.options:
        assert NAME.fullmatch(entry.options["columns"])
        columns = toml(columns_file(entry.options["columns"]), "a mapping needs")
        assert set(columns) <= OF_COLUMNS
        assert not any({"kp_std", "torque_std"} & {*joint} for joint in columns.get("joints", {}).values())


def test_recordings_are_chosen_by_name_and_a_wrong_one_lists_them():
    entries = registry()
    assert [each.name for each in chosen(["ur10", "bow"], entries)] == ["bow", "ur10"]
    assert len(chosen([], entries)) == len(entries)
    with pytest.raises(InputError, match=r"Recordings are bow, .*; got 'ur11'"):
        chosen(["ur11"], entries)


GIVEN = """title = "An arm"
about = "Something"
folder = "arm"
tried = false
[source]
repository = "someone/arm"
[[files]]
name = "arm.xml"
path = "models/arm.xml"
"""


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('"arm"', '"../../evil"', "stay in their folder"),
        ('"arm"', '"/tmp/evil"', "stay in their folder"),
        ('"arm.xml"', '".."', "stay in their folder"),
        ('"arm.xml"', r'"a\\u0000b"', "stay in their folder"),
        ('"models/arm.xml"', '"../arm.xml"', "stay in their folder"),
        ('"someone/arm"', '"../arm"', "stay in their folder"),
        ("tried = false", 'tried = "no"', "tried"),
        ("[source]", "[sources]", "is no entry"),
        ("path =", "paths =", "is no entry"),
        ("[source]", "options = { columns = 3 }\n[source]", "options.columns needs a text, got 3"),
    ],
)
def test_a_malformed_entry_is_one_sentence(old, new, sentence, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(GIVEN, encoding="utf-8")
    assert read_entry(path).folder == "arm"
    path.write_text(GIVEN.replace(old, new.replace(r"\\u", r"\u"), 1), encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        read_entry(path)
