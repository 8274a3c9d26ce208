"""Joint torques, drives and moving bases from a log, against MuJoCo's inverse dynamics."""

import mujoco
import numpy as np
import pytest
from random_models import inverse_dynamics

from experiments.studies.user_files import prepare
from ident.identification import identified
from ident.parameters.base_parameters import find_base_parameters
from ident.recordings.recording import STATES
from sim.models.mujoco_model import parameters_from_model

LEG = """
<mujoco>
  <worldbody>
    <body name="plate">
      <site name="ground" pos=".1 0 -.05" euler="0 20 0"/><geom size=".05" density="500"/>
      <body name="shank" pos="0 0 .1">
        <joint name="ankle" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .02 0 .4" size=".05"/>
        <body name="thigh" pos=".02 0 .4">
          <joint name="knee" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 -.03 0 .4" size=".07"/>
          <body name="trunk" pos="-.03 0 .4">
            <joint name="hip" axis="0 1 0"/><geom type="capsule" fromto="0 .03 0 .02 0 .5" size=".12"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <sensor><force site="ground"/><torque site="ground"/></sensor>
</mujoco>
"""
RATE, SECONDS = 200.0, 10.0
TIME = np.arange(round(RATE * SECONDS)) / RATE


def waves(rng, count, size=1.0):
    """Sums of slow sinusoids and their derivatives (N, count)."""
    out = [np.zeros((len(TIME), count)) for _ in range(3)]
    for k in range(count):
        for f in rng.uniform(0.2, 0.9, 4):
            a, phase, w = size * rng.uniform(0.2, 0.5), rng.uniform(0, 6), 2 * np.pi * f
            for order, x in enumerate((np.sin, np.cos, lambda t: -np.sin(t))):
                out[order][:, k] += a * w**order * x(w * TIME + phase)
    return out


def joint_columns(joints, states):
    named = zip(STATES, states, strict=True)
    return {"time": TIME} | {f"{joint}_{kind}": x[:, k] for kind, x in named for k, joint in enumerate(joints)}


def write(path, columns):
    header, values = ",".join(columns), np.column_stack(list(columns.values()))
    np.savetxt(path, values, delimiter=",", header=header, comments="", fmt="%.17g")


def test_a_planar_study_is_asked_for_what_its_channels_show(tmp_path):
    """Fx, Fz and My of a plate that is turned and off the ankle: noise-free data give their parameters' true values."""
    model = mujoco.MjModel.from_xml_string(LEG)
    states = waves(np.random.default_rng(0), 3)
    _, ground = inverse_dynamics(model, *states)
    columns = joint_columns(("ankle", "knee", "hip"), states)
    columns |= {name: ground[:, k] for name, k in (("ground_fx", 0), ("ground_fz", 2), ("ground_my", 4))}
    path, log, mapping = tmp_path / "leg.xml", tmp_path / "log.csv", tmp_path / "columns.toml"
    path.write_text(LEG, encoding="utf-8")
    write(log, columns)
    mapping.write_text(
        '[wrenches.ground]\nforce = ["ground_fx", "", "ground_fz"]\ntorque = ["", "ground_my", ""]\n'
        "position = [0.1, 0, -0.05]\nrpy_deg = [0, 20, 0]\n",
        encoding="utf-8",
    )
    prepared = prepare(path, log, base="plate", columns=mapping)
    assert prepared.equations.channels == ("Fx", "Fz", "My")
    every = find_base_parameters(prepared.mechanism.tree, gravity=prepared.mechanism.gravity).rank
    rank = prepared.equations.parameters.rank
    hidden = f"{every - rank} of {every} base parameters cannot be seen in Fx, Fz, My, whatever the motion"
    assert rank < every and any(hidden in note for note in prepared.notes)
    result = identified(prepared)
    truth = prepared.equations.parameters.regroup(parameters_from_model(model, "plate"))
    np.testing.assert_allclose(result.psi, truth, atol=1e-6 * abs(truth).max())
    exact = identified(prepared, estimator="weighted")
    np.testing.assert_allclose(exact.psi, truth, atol=1e-8 * abs(truth).max())
    still = dict.fromkeys((f"ankle_{kind}" for kind in STATES), 0 * TIME)
    write(log, columns | still)
    with pytest.raises(ValueError, match=rf"In Fx, Fz, My the recorded motion excites \d+ of {rank} parameters"):
        identified(prepare(path, log, base="plate", columns=mapping), known=False)
