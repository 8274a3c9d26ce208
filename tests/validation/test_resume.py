"""Results that an earlier version left for --resume."""

from dataclasses import replace

import pytest
from registered import TEXT, files_of, recorded, written

from experiments.runs.workers import Workers
from experiments.studies.validation import files, validation_study
from ident.errors import InputError


def refusal(task):
    """Answer to any task."""
    return {"refused": "Not today."}


@pytest.mark.parametrize("changed", ["code", "entry"])
def test_results_of_other_sources_or_entries_are_not_resumed(changed, tmp_path, monkeypatch, here):
    recorded(tmp_path / "arm")
    listed = files_of(tmp_path / "arm", "arm.xml", "one.csv", "two.csv")
    entry = files.read_entry(written(tmp_path, TEXT.format(files=listed, more="")))
    places = files.Places((tmp_path,))
    monkeypatch.setattr(validation_study, "work", refusal)
    monkeypatch.setattr(validation_study, "collected", lambda entries, tasks, answers, refused: answers)
    assert validation_study.study([entry], places, tmp_path, Workers(1)) == [refusal(None)] * 3
    assert validation_study.study([entry], places, tmp_path, Workers(1, resume=True)) == [refusal(None)] * 3
    if changed == "code":
        monkeypatch.setattr(validation_study, "SOURCES", ("sim",))
    else:
        entry = replace(entry, options={**entry.options, "holdout": 0.3})
    named = {"code": "code", "entry": "tasks"}[changed]
    with pytest.raises(InputError, match=f"of another run: {named} differ; leave out --resume"):
        validation_study.study([entry], places, tmp_path, Workers(1, resume=True))
