"""Drives of a position-controlled arm against those of mujoco.sysid, which compares simulations (extra `peers`)."""

import driven_arm
import mujoco
import numpy as np
import pytest

import ident
import sim
from ident.recordings.followers import with_servos

sysid = pytest.importorskip("mujoco.sysid", reason="MuJoCo 4 has sysid")

pytestmark = pytest.mark.extras
pytest.importorskip("absl", reason="what mujoco.sysid imports is in the extra 'peers'")

RATE, STEPS, NOISE = 100, 10, 1e-4
KINDS = {"damping": "Fv", "frictionloss": "Fc", "armature": "Ia"}


def simulated(drives, commands):
    model = mujoco.MjModel.from_xml_string(driven_arm.text(more=driven_arm.ACTUATORS, **drives))
    model.opt.timestep = 1 / (RATE * STEPS)
    data, angles = mujoco.MjData(model), []
    data.qpos[:] = commands[0]
    for command in commands:
        angles.append(data.qpos.copy())
        data.ctrl[:] = command
        mujoco.mj_step(model, data, STEPS)
    return np.array(angles)


def by_simulations(commands, angles):
    """Drives by `mujoco.sysid`, with links, springs and gains known, by name."""
    names = [(kind, k) for kind in KINDS for k in range(3)]
    start = sysid.ParameterDict()
    for kind, k in names:
        start.add(sysid.Parameter(f"{kind}{k}", 0.3 * max(driven_arm.TRUE[kind]), 0.0, 5.0))

    def residual(x, *_):
        columns = []
        for values in np.atleast_2d(np.asarray(x).T):
            drives = {kind: tuple(np.maximum(values[3 * i : 3 * i + 3], 0)) for i, kind in enumerate(KINDS)}
            columns.append(((simulated(drives, commands) - angles) / NOISE).ravel())
        stacked = np.array(columns).T
        return [stacked[:, 0] if np.ndim(x) == 1 else stacked], None, None

    optimal, _ = sysid.optimize(start, residual, optimizer="mujoco", verbose=False, max_iters=40)
    values = zip(names, optimal.as_vector(), strict=True)
    return {f"{KINDS[kind]}({driven_arm.JOINTS[k]})": value for (kind, k), value in values}


def test_drives_are_those_by_which_simulations_follow_the_recorded_angles():
    """Ours know neither the links nor that commands are held."""
    time, channels = driven_arm.commanded(seconds=8.0)
    commands, angles = (
        np.column_stack([channels[f"{joint}_{kind}"] for joint in driven_arm.JOINTS])
        for kind in ("command", "position")
    )
    theirs = by_simulations(commands, angles)
    arm = sim.mechanism(mujoco.MjSpec.from_string(driven_arm.text(more=driven_arm.ACTUATORS)))
    estimate = ident.identify(arm, with_servos(ident.Recording(time, channels), {}, arm, []), known=False)
    ours = dict(zip(estimate.fit.names, estimate.fit.values, strict=True))
    shared = [name for name in theirs if name in ours]
    assert len(shared) == 7
    for name in shared:
        assert ours[name] == pytest.approx(theirs[name], rel=0.1), name
    for kind, column in KINDS.items():
        for joint, true in zip(driven_arm.JOINTS, driven_arm.TRUE[kind], strict=True):
            assert theirs[f"{column}({joint})"] == pytest.approx(true, rel=0.01)
