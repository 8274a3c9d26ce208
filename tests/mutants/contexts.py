"""Plugin of pytest that has `coverage` note the test by which each line is executed, and keeps what each test takes."""

import json
import os
from collections import defaultdict
from pathlib import Path

import coverage
import pytest

from .covered import SECONDS

_seconds, _failed = defaultdict(float), set()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_logstart(nodeid):
    """Lines from here on, also those of fixtures, are executed by this test."""
    coverage.Coverage.current().switch_context(nodeid)


def pytest_runtest_logreport(report):
    """Counts the time of fixtures as well."""
    _seconds[report.nodeid] += report.duration
    if not report.passed:
        _failed.add(report.nodeid)


def pytest_sessionfinish():
    """Writes the seconds of all tests that passed."""
    passed = {test: seconds for test, seconds in _seconds.items() if test not in _failed}
    Path(os.environ[SECONDS]).write_text(json.dumps(passed), encoding="utf-8")
