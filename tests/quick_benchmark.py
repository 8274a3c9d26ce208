"""Numbers of a quick run of the benchmark, measured once for all tests of a worker."""

from functools import cache

import pytest

from experiments.benchmark import sections
from experiments.benchmark.__main__ import main

_measured = cache(sections.measured)


def written(*arguments):
    """Runs the command `benchmark --quick` on these numbers, and returns its exit code."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(sections, "measured", _measured)
        return main(["--quick", *arguments])
