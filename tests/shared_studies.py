"""The studies of the package, simulated and identified once for all tests of a process."""

from functools import cache

from experiments.studies.simulation import study


@cache
def packaged_study(name, /, **options):
    return study(name, **options)
