import subprocess
import sys
from pathlib import Path

import numpy as np

import scenes
from docs.tools.noise.recordings import sinusoids
from sim.simulation.simulate import simulate

UNUSED = ("scipy.ndimage", "scipy.sparse.linalg", "sim.markers.trial_fit", "experiments.runs.workers")
"""Modules that take long to import, and that a short recording of joint angles does not need."""

PDF = ("matplotlib.backends.backend_pdf", "matplotlib.backends.backend_svg", "fontTools.subset")
"""Modules of formats that are not asked for."""


def test_identify_imports_what_it_needs(tmp_path):
    motion, log = sinusoids(np.random.default_rng(0), 2, 2.5), tmp_path / "log.npz"
    simulate(scenes.load("double_pendulum"), motion, samples=250, seed=0).save(log)
    model = Path(scenes.__file__).parent / "double_pendulum.xml"
    options = [model, log, "--base", "base", "--out", tmp_path, "--formats", "png"]
    code = (
        "import sys; from experiments import identify; assert identify.main(sys.argv[1:]) == 0; "
        f"print('slow:', *({{*{UNUSED + PDF}}} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code, *map(str, options)], check=True, capture_output=True, text=True)
    assert run.stdout.splitlines()[-1] == "slow:"
