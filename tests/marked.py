"""Models with sites for markers, their positions in a known motion, and files of it, for the tests."""

import mujoco
import numpy as np

import scenes


def marked_person(per_body=3, seed=0):
    """Specification of the humanoid with sites on all bodies."""
    spec, rng = scenes.load("humanoid"), np.random.default_rng(seed)
    for body in spec.bodies[1:]:
        for k in range(per_body):
            body.add_site(name=f"{body.name}_{k}", pos=rng.normal(scale=0.06, size=3))
    return spec


def trial(model, frames, seed=0, size=0.3):
    """Times, coordinates and positions of all sites of a smooth motion of all degrees of freedom."""
    rng, data, time = np.random.default_rng(seed), mujoco.MjData(model), np.arange(frames) / 100
    amplitude, frequency, phase = (rng.uniform(low, high, model.nv) for low, high in ((0.1, size), (0.2, 0.8), (0, 6)))
    steps = amplitude * np.sin(2 * np.pi * frequency * time[:, None] + phase)
    qpos, x = np.empty((frames, model.nq)), np.empty((frames, model.nsite, 3))
    for k, step in enumerate(steps):
        qpos[k] = model.qpos0
        mujoco.mj_integratePos(model, qpos[k], step, 1.0)
        data.qpos = qpos[k]
        mujoco.mj_kinematics(model, data)
        x[k] = data.site_xpos
    return time, qpos, x


def labels_of(model):
    return [model.site(s).name for s in range(model.nsite)]


def errors(model, estimate, truth):
    """Differences of coordinates as steps of the degrees of freedom (N, nv)."""
    out = np.empty((len(truth), model.nv))
    for e, a, b in zip(out, truth, estimate, strict=True):
        mujoco.mj_differentiatePos(model, e, 1.0, a, b)
    return out


def trc(time, labels, x, unit="mm", factor=1e3):
    names = "\t".join(("DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units"))
    axes = "\t".join(f"{axis}{k + 1}" for k in range(len(labels)) for axis in "XYZ")
    head = [
        "PathFileType\t4\t(X/Y/Z)\ttrial.trc",
        names,
        f"100\t100\t{len(time)}\t{len(labels)}\t{unit}",
        "Frame#\tTime\t" + "\t\t\t".join(labels) + "\t\t",
        f"\t\t{axes}",
        "",
    ]
    rows = [
        f"{k + 1}\t{t!r}\t" + "\t".join("" if np.isnan(v) else repr(float(factor * v)) for v in frame.ravel())
        for k, (t, frame) in enumerate(zip(time.tolist(), x, strict=True))
    ]
    return "\n".join([*head, *rows]) + "\n"
