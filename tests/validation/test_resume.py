"""Results that an earlier version left for --resume."""

import json

import pytest
from registered import TEXT, files_of, recorded, written

from experiments.runs.workers import Checkpoint, Workers
from experiments.studies.validation import files, study
from ident.errors import InputError


@pytest.mark.parametrize("form", [{}, {"form": 0}])
def test_results_of_another_form_are_not_resumed(form, tmp_path):
    recorded(tmp_path / "arm")
    listed = files_of(tmp_path / "arm", "arm.xml", "one.csv", "two.csv")
    entry = files.read_entry(written(tmp_path, TEXT.format(files=listed, more="")))
    tasks = [[task.entry.name, task.trial, False] for task in study.tasks_of([entry], {"arm": tmp_path / "arm"})]
    answer = json.dumps({"truths": {"": {"names": [], "values": []}}})
    Checkpoint("recordings", tmp_path / study.FILE, {"tasks": tasks, **form}).save([answer])
    with pytest.raises(InputError, match="of another run: form differ; leave out --resume"):
        study.study([entry], files.Places((tmp_path,)), tmp_path, Workers(1, resume=True))
