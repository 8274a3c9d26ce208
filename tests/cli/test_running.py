"""Beginning and end of a command."""

import argparse
from pathlib import Path

import pytest

from experiments.cli import running
from ident.errors import InputError


@pytest.mark.parametrize("before", [None, "mine"])
def test_a_refusal_leaves_no_log_of_mujoco(tmp_path, monkeypatch, before):
    monkeypatch.chdir(tmp_path)
    log = Path("MUJOCO_LOG.TXT")
    if before:
        log.write_text(before, encoding="utf-8")

    def study(options):
        with log.open("a", encoding="utf-8") as file:
            file.write("WARNING: Nan, Inf or huge value in QACC")
        raise InputError("The servos lost the excitation.")

    assert running.run(study, argparse.ArgumentParser, []) == 2
    assert log.exists() is bool(before)
