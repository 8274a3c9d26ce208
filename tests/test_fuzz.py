"""The fuzz command itself, and a short run of it."""

import sys
import time

import numpy as np
import pytest
from fuzz import __main__ as command
from fuzz import commands

pytestmark = pytest.mark.slow


def test_damaged_input_is_refused_or_accepted(capsys):
    assert command.main(["--cases", "30", "--seed", "2"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    counts = {word: int(number) for number, word in map(str.split, last.split(", "))}
    assert sum(counts.values()) == 30 and min(counts["accepted"], counts["refused"]) >= 3


@pytest.mark.parametrize(
    ("wrong", "kind", "what"),
    [
        (lambda options: {}["missing"], "traceback", "KeyError under test_fuzz.py:<lambda>"),
        (lambda options: np.empty(10**15), "foreign", "MemoryError under test_fuzz.py:<lambda>: Unable to allocate"),
        (lambda options: sys.exit(3), "odd", "exit 3 after 0 error lines"),
        (lambda options: [time.process_time() for _ in iter(int, 1)], "hang", "longer than 0.2 s"),
    ],
)
def test_what_must_not_happen_is_seen(monkeypatch, wrong, kind, what):
    if kind == "hang":
        monkeypatch.setattr(command, "HANG", 0.2)
    monkeypatch.setattr(commands, "COMMANDS", (commands.PLAIN,))
    monkeypatch.setattr(commands.PLAIN.module, "run", wrong)
    with command.runner(3) as run:
        ended, why, _ = run(0)
    assert ended == kind and what in why
