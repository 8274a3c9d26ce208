"""Guesses for logs of ten drivers and tools are right or left open, never wrong."""

import re
from collections import Counter
from itertools import chain
from pathlib import Path

import pytest
from guesses.forty_logs import logs

import experiments
from experiments.guesses.belief import DOUBTFUL
from experiments.guesses.guess import believed
from ident.files.column import CURRENT
from ident.recordings.plates import AUTO


def judged(log, folder):
    """Wrong columns, missing columns, and the belief."""
    belief = believed(log.mechanism, [log.write(folder)])
    guesses = {f"{x.joint}.{x.kind}": x for x in belief.quantities.values() if x.column and x.sure != DOUBTFUL}
    wrong, lacking = [], [key for key, truth in log.truth.items() if truth and key not in guesses]
    for key, guess in guesses.items():
        column, factor = log.truth.get(key) or ("no column", 1.0)
        scale = guess.gain * (CURRENT[guess.unit] if guess.unit in CURRENT else belief.factor(guess))
        if guess.column != column or abs(scale / factor - 1) > (0.3 if guess.unit in CURRENT else 1e-6):
            wrong.append(f"{key} ← {scale:g} {guess.column}, not {factor:g} {column}")
    there = {}
    for group in belief.outer.values():
        entries = {key: entry.value for key, entry in group.entries.items()}
        there[tuple(chain(*(entries[k] for k in ("force", "torque", "free_moment") if k in entries)))] = entries
    for columns, body in log.wrenches.items():
        entries = there.pop(columns, None)
        if entries is None:
            lacking.append(columns[0])
            continue
        on = entries["among"] if entries.get("on") == AUTO else [entries.get("on"), entries.get("body")]
        units = {entries.get(key) for key in ("unit", "torque_unit", "point_unit")} - {None, "N", "N m", "m"}
        if (body and body not in on) or {"rpy_deg", "applied_to_link"} & entries.keys() or units:
            wrong.append(f"{columns[0]}: {entries}")
    return wrong + [f"a wrench of {', '.join(columns)}" for columns in there], lacking, belief


def all_logs():
    """All logs; of each tool the first, and those with a question, are fast enough for every run."""
    tools = set()
    for log in logs():
        fast = log.asked or log.tool not in tools
        tools.add(log.tool)
        yield pytest.param(log, id=f"{log.tool}: {log.about}", marks=() if fast else pytest.mark.slow)


@pytest.mark.parametrize("log", list(all_logs()))
def test_what_is_guessed_is_right_or_asked(log, tmp_path):
    wrong, lacking, belief = judged(log, tmp_path)
    is_open = lacking or None in log.truth.values()
    assert not wrong and bool(is_open) == log.asked and (not is_open or belief.open), lacking


def test_the_table_of_the_documentation_counts_them():
    page = Path(experiments.__file__).parents[1] / "docs" / "recordings.md"
    if not page.exists():
        pytest.skip("only a checkout has docs")
    rows = re.findall(r"^\| ([^|]+?) \| (\d+) \| (\d+) \| (\d+) \|", page.read_text(encoding="utf-8"), re.MULTILINE)
    counted = Counter((log.tool, log.asked) for log in logs())
    tools = list(dict.fromkeys(log.tool for log in logs()))
    expected = [(tool, str(counted[tool, False]), str(counted[tool, True]), "0") for tool in tools]
    assert rows == [*expected, ("all", *(str(sum(int(row[k]) for row in expected)) for k in (1, 2, 3)))]
