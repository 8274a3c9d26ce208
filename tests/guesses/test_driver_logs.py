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
from ident.files.column import CURRENT, UNITS
from ident.recordings.columns.plates import AUTO


def scale(quantity, contents):
    """Factor from a column to SI."""
    if quantity.unit in CURRENT:
        return quantity.gain * CURRENT[quantity.unit]
    units = {unit: factor for kinds in UNITS.values() for unit, factor in kinds.items()}
    return quantity.gain * units.get(
        quantity.unit or ("deg" if contents.units.get(quantity.column) == "deg" else ""), 1.0
    )


def judged(log, folder):
    """`right`, `asked` or `wrong`, and the quantities in question."""
    belief = believed(log.mechanism, [log.write(folder)])
    guesses = {f"{x.joint}.{x.kind}": x for x in belief.quantities.values() if x.column and x.sure != DOUBTFUL}
    wrong, lacking = [], [key for key, truth in log.truth.items() if truth and key not in guesses]
    for key, guess in guesses.items():
        if log.truth.get(key) is None:
            wrong.append(f"{key} ← {guess.column}")
            continue
        column, factor = log.truth[key]
        off = abs(scale(guess, belief.log) / factor - 1)
        if guess.column != column or off > (0.3 if guess.unit in CURRENT else 1e-6):
            wrong.append(f"{key} ← {scale(guess, belief.log):g} {guess.column}, not {factor:g} {column}")
    there = {}
    for group in belief.groups.values():
        if not group.is_doubtful:
            listed = [group.entries[k].value for k in ("force", "torque", "free_moment") if k in group.entries]
            there[tuple(chain(*listed))] = group
    for columns, body in log.wrenches.items():
        if columns not in there:
            lacking.append(columns[0])
            continue
        entries = there.pop(columns).entries
        on = entries["among"].value if entries.get("on") and entries["on"].value == AUTO else None
        named = [entries[k].value for k in ("on", "body") if k in entries]
        if (body and body not in (on or named)) or {"rpy_deg", "applied_to_link"} & entries.keys():
            wrong.append(f"{columns[0]} is on {on or named}, turned {sorted(entries)}")
        if any(
            entries[k].value not in ("N", "N m", "m") for k in ("unit", "torque_unit", "point_unit") if k in entries
        ):
            wrong.append(f"{columns[0]} has another unit")
    wrong += [f"a wrench of {', '.join(columns)}" for columns in there]
    open_ones = any(log.truth[k] is None for k in log.truth)
    return "wrong" if wrong else "asked" if lacking or open_ones else "right", wrong or lacking, belief


def all_logs():
    """All logs; of each tool the first, and those with a question, are fast enough for every run."""
    tools = set()
    for log in logs():
        fast = log.asked or log.tool not in tools
        tools.add(log.tool)
        yield pytest.param(log, id=log.name, marks=() if fast else pytest.mark.slow)


@pytest.mark.parametrize("log", list(all_logs()))
def test_what_is_guessed_is_right_or_asked(log, tmp_path):
    outcome, about, belief = judged(log, tmp_path)
    assert outcome == ("asked" if log.asked else "right"), about
    assert outcome == "right" or belief.open


def test_the_table_of_the_documentation_counts_them():
    page = Path(experiments.__file__).parents[1] / "docs" / "recordings.md"
    if not page.exists():
        pytest.skip("only a checkout has docs")
    rows = re.findall(r"^\| ([^|]+?) \| (\d+) \| (\d+) \| (\d+) \|", page.read_text(encoding="utf-8"), re.MULTILINE)
    counted = Counter((log.tool, log.asked) for log in logs())
    tools = list(dict.fromkeys(log.tool for log in logs()))
    expected = [(tool, str(counted[tool, False]), str(counted[tool, True]), "0") for tool in tools]
    assert rows == [*expected, ("all", *(str(sum(int(row[k]) for row in expected)) for k in (1, 2, 3)))]
