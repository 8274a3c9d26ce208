"""A page of an identification of the double pendulum in contact, for the tests that look at it."""

import json
import re
from dataclasses import replace
from pathlib import Path

import scenes
from experiments import identify
from ident.recordings.wrench import Sensor
from sim import mechanism, simulate
from sim.motion.excitation import DOUBLE_PENDULUM

PENDULUM = Path(scenes.__file__).parent / "double_pendulum.xml"


def options(folder, *more, seed=0):
    """Writes the log, and returns options of the command that writes the page."""
    spec = scenes.load("double_pendulum", contact="pad")
    original = simulate(spec, DOUBLE_PENDULUM, samples=500, seed=seed)
    kept = {name: x for name, x in original.measured.items() if name.startswith(("ground", "contact", "joint"))}
    cell = Sensor(*mechanism(spec, "base").site("contact"), applied_to_link=False)
    replace(original, measured=kept, true={}, noise={}).with_sensors({"contact": cell}).save(folder / "log.npz")
    given = ["--base", "base", "--estimator", "weighted", "--name", "out", "--out", str(folder), *more]
    return [str(PENDULUM), str(folder / "log.npz"), *given]


def identified(folder):
    assert identify.main(options(folder)) == 0
    return folder / "out"


def replayed(page):
    text = page.read_text(encoding="utf-8")
    return json.loads(re.search(r'<script type="application/json" id="replay">(.*?)</script>', text, re.DOTALL)[1])
