# # Where joints lie
#
# Joints that lie elsewhere than in the model, found to a tenth of a millimetre where poses of the tool show it.

from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

import multicontact as mc
from ident.recordings.stated import Tracker

arm = mc.mechanism(Path(mc.scenes.__file__).parent / "arm.xml", base="base")
rng, time, stated = np.random.default_rng(5), np.arange(600) / 100, 2e-3
moved, true = list(arm.tree.bodies), {}
for k in range(2, 5):
    home, shift = moved[k].home.copy(), stated * rng.normal(size=3)
    home[:3, 3] += shift
    moved[k] = replace(moved[k], home=home)
    true |= {f"centre_{axis}({moved[k].joint})": x for axis, x in zip("xyz", shift, strict=True)}
tree = replace(arm.tree, bodies=tuple(moved))

pulsation, phase = 2 * np.pi * 0.2 * np.arange(1, 6), rng.uniform(0, 6.3, (4, 5))
waves = [np.exp(1j * (pulsation * time[:, None, None] + phase)) * (1j * pulsation) ** d for d in range(3)]
q, dq, ddq = (0.2 * wave.real.sum(axis=2) for wave in waves)
torques = mc.joint_torque_regressor(tree, q, dq, ddq, gravity=arm.gravity) @ arm.known
poses = tree.poses(q)[:, -1]
turned = Rotation.from_matrix(poses[:, :3, :3]) * Rotation.from_rotvec(2e-4 * rng.normal(size=(600, 3)))
measured = {f"{joint}_position": q[:, k] + 1e-4 * rng.normal(size=600) for k, joint in enumerate(arm.tree.joints)}
measured |= {f"{joint}_torque": torques[:, k] + 0.02 * rng.normal(size=600) for k, joint in enumerate(arm.tree.joints)}
measured |= {"tool_position": poses[:, :3, 3] + 1e-4 * rng.normal(size=(600, 3))}
measured |= {"tool_orientation": turned.as_quat(scalar_first=True)}
recording = mc.Recording(time, measured, trackers={"tool": Tracker("tool")})
fit = mc.identify(arm, recording, drive=[], known=False, setup={"centre": stated, "axis": 0, "zero": 0}).trajectory.fit

names = list(true)[::-1]
at = [fit.names.index(name) for name in names]
value, std = fit.theta[at], np.sqrt(np.diag(fit.covariance)[at])
inside = np.abs(value - [true[name] for name in names]) < 1.96 * std
print(f"{inside.sum()} of {len(names)} intervals contain the truth, {np.sum(std < 1e-4)} known to 0.1 mm")

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle("Displacements of an arm's joints, from torques and poses of its tool")
rows, factor = np.arange(len(names)), 1e3
panel.axvspan(-1.96 * factor * stated, 1.96 * factor * stated, color="0.93", label="95 % as stated")
panel.errorbar(factor * value, rows, xerr=1.96 * factor * std, fmt="o", color="C0", capsize=3, label="estimate, 95 %")
panel.plot([factor * true[name] for name in names], rows, "x", color="C1", mew=2, label="truth")
panel.set_yticks(rows, [name[7:].replace("(", " of ").rstrip(")") for name in names])
panel.set_xlabel("displacement along an axis of the parent's frame (mm)")
figure.legend(loc="outside lower center", ncols=3)
