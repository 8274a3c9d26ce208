"""Tries an installed wheel, not the checkout: the compiled part, a tiny identification, the command.

And its types, if mypy is installed beside it.
"""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import multicontact as mc
from ident.model.compiled import available
from sim.motion.excitation import DOUBLE_PENDULUM

ROOT = Path(__file__).resolve().parents[1]
"""The checkout, from which nothing is imported."""

CLIENT = """import multicontact as mc

arm = mc.mechanism("arm.xml", base="base")
version: str = mc.__version__
identified: mc.Estimate = mc.identify(arm, "run.csv")
print(mc.idntify)
"""
"""A client whose last line has the one error."""


def main() -> None:
    """Imports all that is installed, and identifies a double pendulum from two seconds."""
    assert ROOT not in Path(mc.__file__).resolve().parents, f"{mc.__file__} is the checkout's, not the wheel's"
    # The compiler for Windows does not know the extensions that the code is written in.
    assert available() or sys.platform == "win32", "the wheel is without ident.model._blocks"
    scene = mc.scenes.load("double_pendulum")
    arm = mc.mechanism(scene, base="base")
    estimate = mc.identify(arm, mc.simulate(scene, DOUBLE_PENDULUM, samples=200))
    assert np.isfinite(estimate.psi).all() and len(estimate.psi) == estimate.base.rank
    mass = estimate.psi[estimate.base.names.index("m1")]
    assert abs(mass / arm.known.reshape(-1, 10)[:, 0].sum() - 1) < 0.1, f"m1 is {mass:.3g} kg"
    subprocess.run([sys.executable, "-m", "experiments.identify", "--help"], check=True, stdout=subprocess.DEVNULL)
    typed = find_spec("mypy") is not None
    if typed:
        check_types()
    print(f"{mc.__version__}, compiled: {available()}, types checked: {typed}, mass of all bodies: {mass:.4g} kg")


def check_types() -> None:
    """Checks a client in strict mode: it has types, and one name that is not there."""
    with TemporaryDirectory() as folder:
        Path(folder, "client.py").write_text(CLIENT, encoding="utf-8")
        command = [sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", "client.py"]
        checked = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    *errors, _ = checked.stdout.splitlines() or [""]
    assert len(errors) == 1 and '"idntify"' in errors[0], checked.stdout + checked.stderr


if __name__ == "__main__":
    main()
