"""Pytest plugin: records the test that executes each line, by `coverage`, and the duration of each test."""

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
    """Assigns lines from here on, also those of fixtures, to this test."""
    coverage.Coverage.current().switch_context(nodeid)


def pytest_runtest_logreport(report):
    """Adds up durations, including fixtures."""
    _seconds[report.nodeid] += report.duration
    if not report.passed:
        _failed.add(report.nodeid)


def pytest_sessionfinish():
    """Writes the durations of all tests that passed."""
    passed = {test: seconds for test, seconds in _seconds.items() if test not in _failed}
    Path(os.environ[SECONDS]).write_text(json.dumps(passed), encoding="utf-8")
