"""Stand-ins for what takes most of a study's time: processes, drawing, and trajectory estimates."""

from concurrent.futures import Executor, Future
from types import SimpleNamespace

import numpy as np
from matplotlib.figure import Figure

from experiments.data import simulated_study
from experiments.document import figures
from experiments.document.writer import Plot
from ident.errors import ExcitationError


class Here(Executor):
    """Runs tasks at once in this process, in place of `workers.Processes`."""

    def __init__(self, number=1):
        """Starts nothing."""

    def submit(self, work, /, *args, **kwargs):
        future = Future()
        try:
            future.set_result(work(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future

    def start(self):
        """Does nothing."""

    kill = start


def not_drawn(figure, extension):
    return b""


def leave_undrawn(patched):
    """Draws no figures while a monkeypatch lasts: those of documents are empty, and so are their files."""
    patched.setattr(figures, "drawn", not_drawn)
    patched.setattr(Plot, "figure", Figure())


def truth(mechanism, recording, base, **_):
    psi = base.regroup(mechanism.known)
    return SimpleNamespace(psi=psi, std_setup=np.ones_like(psi))


def undetermined(*_, **__):
    raise ExcitationError("The recording does not determine all parameters.", ())


def once(function):
    """The function, which returns what its first call did, whatever it is given."""
    first = []

    def called(*given, **options):
        first.append(first[0] if first else function(*given, **options))
        return first[0]

    return called


def use_truth(patched):
    """Replaces the studies' trajectory estimates by the truth, and leaves axes as drawn, while a monkeypatch lasts."""
    patched.setattr(simulated_study, "trajectory_estimate", truth)
    patched.setattr(simulated_study, "searched_axes", lambda *_: None)
