"""Tries an installed wheel, not the checkout: the compiled part, a tiny identification, and the command."""

import subprocess
import sys
from pathlib import Path

import numpy as np

import ident
import scenes
import sim
from ident.model.compiled import available
from sim.motion.excitation import DOUBLE_PENDULUM

ROOT = Path(__file__).resolve().parents[1]
"""The checkout, from which nothing is imported."""


def main() -> None:
    """Imports all that is installed, and identifies a double pendulum from two seconds."""
    assert ROOT not in Path(ident.__file__).resolve().parents, f"{ident.__file__} is the checkout's, not the wheel's"
    # The compiler for Windows does not know the extensions that the code is written in.
    assert available() or sys.platform == "win32", "the wheel is without ident.model._blocks"
    arm = sim.mechanism(scenes.load("double_pendulum"), base="base")
    estimate = ident.identify(arm, sim.simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, samples=200))
    assert np.isfinite(estimate.psi).all() and len(estimate.psi) == estimate.base.rank
    mass = estimate.psi[estimate.base.names.index("m1")]
    assert abs(mass / arm.known.reshape(-1, 10)[:, 0].sum() - 1) < 0.1, f"m1 is {mass:.3g} kg"
    subprocess.run([sys.executable, "-m", "experiments.identify", "--help"], check=True, stdout=subprocess.DEVNULL)
    print(f"{ident.__version__}, compiled: {available()}, mass of all bodies: {mass:.4g} kg")


if __name__ == "__main__":
    main()
