"""Stand-ins for what takes most of a study's time: processes, drawing, and trajectory estimates."""

from concurrent.futures import Executor, Future

import numpy as np
from matplotlib.figure import Figure

from experiments.data import simulated_study
from experiments.data.fitting import Trial
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
    return Trial(base, psi, np.ones_like(psi), psi)


def undetermined(*_, **__):
    raise ExcitationError("The recording does not determine all parameters.", ())


def use_truth(patched):
    """Replaces the studies' trajectory estimates by the truth, and leaves axes as drawn, while a monkeypatch lasts."""
    patched.setattr(simulated_study, "trajectory_fit", truth)
    patched.setattr(simulated_study, "searched_axes", lambda *_: None)
