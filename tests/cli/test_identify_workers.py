"""Who computes the pieces of identify's trajectory estimate."""

import argparse
import os
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from stand_ins import Here

from experiments import identify
from experiments.runs.environment import THREADS

SHORT, LONGER, LONG = identify.THREADED - 1, identify.THREADED, identify.PAYS


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("work", "workers", "threads", "kind"),
    [
        (SHORT, None, "1", type(None)),
        (LONGER, None, "1", ThreadPoolExecutor),
        (LONGER, 1, "1", type(None)),
        (LONGER, 2, "1", Here),
        (LONGER, None, "4", type(None)),
        (LONG, None, "1", Here),
    ],
)
def test_threads_share_the_pieces_of_recordings_that_are_neither_short_nor_long(
    monkeypatch, work, workers, threads, kind
):
    """Unless linear algebra has threads of its own, or one worker is asked for."""
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    for name in THREADS:
        monkeypatch.setenv(name, threads)
    log = SimpleNamespace(samples=SimpleNamespace(motion=SimpleNamespace(q=np.zeros((work, 1)))))
    with identify._workers(argparse.Namespace(workers=workers, estimator="trajectory"), [log]) as executor:
        assert type(executor) is kind
