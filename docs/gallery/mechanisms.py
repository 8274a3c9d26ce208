# # Mechanisms, and what their models lack
#
# Poses, wrenches and parameters of mechanisms; axes, delays, places of joints and friction that recordings show.

from dataclasses import replace
from math import pi
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.spatial.transform import Rotation

import multicontact as mc
from ident.recordings.stated import Tracker
from sim.motion.excitation import DOUBLE_PENDULUM, Excitation

# ## A held double pendulum
#
# Postures of the paper's double pendulum while a hand holds its end, with the forces of ground and hand.

spec = mc.scenes.load("double_pendulum", contact="handle")
pendulum = mc.mechanism(spec, base="base")
recording = mc.simulate(spec, DOUBLE_PENDULUM, samples=400)
sensor = mc.Sensor(*pendulum.sites["contact"], applied_to_link=False)
recording = recording.with_sensors({"contact": sensor})
poses = pendulum.tree.poses(recording.joint_states(pendulum.tree.joints)[0])
names = pendulum.tree.names
end = poses[:, names.index(sensor.body)] @ sensor.pose
ground = recording["ground_force"]
hand = recording.total_wrench(pendulum.tree).values[:, :3] - ground

figure, (side, over) = plt.subplots(2, figsize=(6, 4), height_ratios=(2, 1), layout="constrained")
figure.suptitle("Forces of ground and hand on a double pendulum")
colors = {"ground": "C1", "hand": "C2"}
for place, k in enumerate((60, 160, 260, 360)):
    shift = np.array([1.5 * place, 0])
    points = np.array([*(poses[k, names.index(link), 1:3, 3] for link in ("link1", "link2")), end[k, 1:3, 3]]) + shift
    side.plot(*points.T, "o-", color="0.4", lw=5, ms=8, solid_capstyle="round")
    for start, force, color in zip(points[[0, -1]], (ground[k], hand[k]), colors.values(), strict=True):
        arrow = {"arrowstyle": "-|>", "color": color, "lw": 2, "shrinkA": 0, "shrinkB": 0}
        side.annotate("", start + force[1:3] / 350, start, arrowprops=arrow, annotation_clip=False)
    over.axvline(recording.time[k], color="0.8", lw=1)
side.set(aspect="equal", xlim=(-0.6, 5.4), ylim=(-0.35, 1.15))
side.set_axis_off()
for (name, color), force in zip(colors.items(), (ground, hand), strict=True):
    over.plot(recording.time, np.linalg.norm(force, axis=1), color=color, label=name)
over.set(xlabel="time (s)", ylabel="force (N)", xlim=(0, 4))
figure.legend(loc="outside lower center", ncols=2)

# ## The total wrench of two contacts
#
# A pad and a hand take part of the load; together with the ground's moment theirs is the one that the motion requires.

spec = mc.scenes.load("double_pendulum", contact="pad handle")
pendulum = mc.mechanism(spec, base="base")
recording = mc.simulate(spec, DOUBLE_PENDULUM, samples=600)
sensors = {name: mc.Sensor(*pendulum.sites[name], applied_to_link=False) for name in ("contact_pad", "contact_handle")}
recording = recording.with_sensors(sensors)
states = recording.joint_states(pendulum.tree.joints)
required = mc.base_wrench_regressor(pendulum.tree, *states, gravity=pendulum.gravity) @ pendulum.known
without = {
    "ground alone": ("contact_pad", "contact_handle"),
    "ground and pad": ("contact_handle",),
    "ground, pad and hand": (),
}

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle("Moment at the base with more and more contacts")
for (label, names), color in zip(without.items(), ("C1", "C2", "black"), strict=True):
    total = recording.total_wrench(pendulum.tree, names).values
    panel.plot(recording.time, total[:, 3], color=color, lw=2 if not names else 1.2, label=label)
panel.plot(recording.time, required[:, 3], "--", color="C0", lw=1.2, label="required by the motion, $Y\\varphi$")
panel.set(xlabel="time (s)", ylabel=r"$\tau_x$ (N m)")
figure.legend(loc="outside lower center", ncols=2)
print(f"largest difference {np.abs(total - required).max():.1f} N or N m with all contacts")

# ## Base parameters of an arm with seven joints
#
# Which standard parameters (columns) make up which base parameters (rows); it follows from the geometry alone.

alpha = (0, -pi / 2, pi / 2, pi / 2, -pi / 2, pi / 2, pi / 2)
d = (0, 0, 0, 0.0825, -0.0825, 0, 0.088)
r = (0.333, 0, 0.316, 0, 0.384, 0, 0)
rows = enumerate(zip(alpha, d, r, strict=True), start=1)
frames = [
    mc.Frame(f"link{k}", f"link{k - 1}" if k > 1 else None, "revolute", alpha=a, d=x, r=z) for k, (a, x, z) in rows
]
base = mc.find_base_parameters(mc.Mechanism(mc.tree_from_mdh(frames), np.array([0, 0, -9.81])))
matrix = np.zeros((base.rank, len(base.parameters)))
matrix[np.arange(base.rank), list(base.kept)] = 1
matrix[:, list(base.dependent)] = base.beta
print(f"{base.rank} of {len(base.parameters)}; {base.expressions(3)[3]}")

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle(f"{base.rank} base parameters of {len(base.parameters)} standard parameters")
image = panel.imshow(np.where(matrix == 0, np.nan, matrix), cmap="coolwarm", vmin=-1, vmax=1, aspect="auto")
for body in range(1, len(frames)):
    panel.axvline(10 * body - 0.5, color="0.7", lw=0.5)
panel.set_xticks(10 * np.arange(len(frames)) + 4.5, [f"link {k}" for k in range(1, len(frames) + 1)])
panel.set(ylabel="base parameter", xlabel="standard parameter")
panel.tick_params(axis="x", length=0)
figure.colorbar(image, label="coefficient", extend="both")

# ## Axes that are not where the model has them
#
# Errors of base parameters if the axes are tilted and the model's are not: one degree costs more than the noise.

drawn = mc.mechanism(mc.scenes.load("double_pendulum"), base="base")
base = mc.find_base_parameters(drawn)
angles, errors = (0, 1, 2, 3, 4, 5), {"axes along X": [], "axes as they are": []}
for angle in angles:
    spec = mc.scenes.load("double_pendulum", tilt_deg=angle, azimuth_deg=120)
    recording = mc.simulate(spec, DOUBLE_PENDULUM, samples=500)
    for name, model in zip(errors, (drawn, mc.mechanism(spec, base="base")), strict=True):
        equations = mc.Equations(model, mc.find_base_parameters(model, kept=base.names))
        fit = mc.least_squares(equations, recording)
        errors[name].append(np.abs(fit.psi - fit.parameters.regroup(drawn.known)))
print(f"at 5°, axes along X: largest error {errors['axes along X'][-1].max():.1f}")

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle("Errors of 13 base parameters over the tilt of the axes")
for (name, of_name), color in zip(errors.items(), ("C1", "C0"), strict=True):
    panel.semilogy(angles, of_name, color=color, lw=0.6, alpha=0.7)
    panel.semilogy(angles, np.max(of_name, axis=1), "o-", color=color, lw=2, label=f"largest, model with {name}")
panel.set(xlabel="tilt (°)", ylabel="error (kg, kg m, kg m²)", ylim=(1e-3, 5))
panel.legend(loc="lower right", framealpha=1)

# ## A sensor that is late
#
# The likelihood of each delay of a force plate's clock, from a recording whose wrenches came 8 ms late;
# all else of the set-up is exact.

LATE = 0.008
pendulum = mc.mechanism(mc.scenes.load("double_pendulum"), base="base")
rng, time = np.random.default_rng(0), np.arange(0, 9, 0.01)
equations = mc.Equations.of_wrench(pendulum)
late = mc.base_wrench_regressor(pendulum.tree, *DOUBLE_PENDULUM.trajectory(time - LATE), gravity=pendulum.gravity)
wrench = late @ pendulum.known + rng.normal(size=(len(time), 6)) * [1.2, 1.2, 1.2, 0.12, 0.12, 0.12]
angles = DOUBLE_PENDULUM.trajectory(time)[0] + 2.5e-4 * rng.normal(size=(len(time), 2))
channels = {f"{joint}_position": q for joint, q in zip(pendulum.tree.joints, angles.T, strict=True)}
recording = mc.Recording(time, channels | {"ground_force": wrench[:, :3], "ground_torque": wrench[:, 3:]})
exact = dict.fromkeys(("clock", "origin", "rotation", "gain", "gravity", "zero", "axis", "centre"), 0.0)
(delay,) = mc.identify(pendulum, recording, offsets=False, setup=exact).setup
print(delay.text)

delays = np.linspace(0.0074, 0.0086, 121)
motions = (mc.Motion(*DOUBLE_PENDULUM.trajectory(time - each)) for each in delays)
fits = [mc.least_squares(equations, mc.Samples(motion, wrench)) for motion in motions]
logarithm = -len(time) * np.array([np.log(fit.residual_norms).sum() for fit in fits])

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle("Likelihood of a delay")
estimated = np.exp(-(((delays - delay.value) / delay.std) ** 2) / 2)
panel.plot(1e3 * delays, np.exp(logarithm - logarithm.max()), color="0.5", label="angles known exactly")
panel.plot(1e3 * delays, estimated, color="C0", label="estimate, angles with noise")
within = np.abs(delays - delay.value) < 1.96 * delay.std
panel.fill_between(1e3 * delays, estimated, where=within, color="C0", alpha=0.2, label="its 95 % interval")
panel.axvline(1e3 * LATE, color="black", ls="--", lw=1, label="true")
panel.set(xlabel="delay of the wrench (ms)", ylabel="likelihood over its maximum", ylim=(0, 1.05))
figure.legend(loc="outside lower center", ncols=2)

# ## Friction at reversals
#
# What the links do not explain of an elbow's torque: it jumps with the sign of the velocity, and grows with it.

folder = Path(mc.scenes.__file__).parent
arm = mc.mechanism(folder / "arm.xml", base="base")
recording = mc.read_log(folder / "arm.csv", arm)
estimate = mc.identify(arm, recording, leave_out=("Fx", "Fy", "Fz", "Mx", "My", "Mz"))
motion = estimate.prepared.samples.motion
drive, elbow = estimate.drives["elbow"], arm.tree.joints.index("elbow")
links = mc.joint_torque_regressor(arm.tree, *motion.states, gravity=arm.gravity) @ estimate.consistent().phi
left = (recording["elbow_torque"] - links[:, elbow] - drive.rotor * motion.ddq[:, elbow])[estimate.part]
speed = motion.dq[estimate.part, elbow]
print(f"Coulomb {drive.coulomb:.2f} N m, viscous {drive.viscous:.2f} N m s")

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle("Torque of an elbow without that of its links and rotor")
panel.plot(speed, left, ".", color="0.6", ms=3, label="measured")
for sign in (-1, 1):
    line = sign * np.array([0, np.abs(speed).max()])
    law = sign * drive.coulomb + drive.viscous * line
    panel.plot(line, law, color="C1", lw=2, label=f"{drive.coulomb:.2f} N m + {drive.viscous:.2f} N m s" * (sign > 0))
panel.set(xlabel="velocity (rad/s)", ylabel="torque (N m)")
panel.legend()

# ## Where joints lie
#
# Places of joints that are not the model's, and with one the upper arm's length, found to a tenth of a millimetre where
# poses of the tool show them; the forearm, about which the wrist turns, does not show its length.

rng, time, joints, bodies, stated = np.random.default_rng(5), np.arange(600) / 100, arm.tree.joints, arm.tree.bodies, 2
shifts = stated * rng.normal(size=(3, 3))
homes = [body.home + 1e-3 * np.pad(x[:, None], ((0, 1), (3, 0))) for body, x in zip(bodies[2:], shifts, strict=True)]
moved = (replace(body, home=home) for body, home in zip(bodies[2:], homes, strict=True))
tree = replace(arm.tree, bodies=(*bodies[:2], *moved))

frequency = np.tile(0.2 * np.arange(1, 6), (4, 1))
motion = Excitation(np.zeros(4), 8 * frequency**2, frequency, rng.uniform(0, 6.3, (4, 5))).trajectory(time)
torques = mc.joint_torque_regressor(tree, *motion, gravity=arm.gravity) @ arm.known
poses = tree.poses(motion[0])[:, -1]
turned = Rotation.from_matrix(poses[:, :3, :3]) * Rotation.from_rotvec(2e-4 * rng.normal(size=(600, 3)))
measured = {f"{joint}_position": q + 1e-4 * rng.normal(size=600) for joint, q in zip(joints, motion[0].T, strict=True)}
measured |= {f"{joint}_torque": x + 0.02 * rng.normal(size=600) for joint, x in zip(joints, torques.T, strict=True)}
measured |= {"tool_position": poses[:, :3, 3] + 1e-4 * rng.normal(size=(600, 3))}
measured |= {"tool_orientation": turned.as_quat(scalar_first=True)}
recording, setup = mc.Recording(time, measured, trackers={"tool": Tracker("tool")}), {"axis": 0, "zero": 0}
fit = mc.identify(arm, recording, drive=[], known=False, setup=setup | {"centre": 1e-3 * stated}).trajectory.fit

at = [fit.names.index(f"centre_{axis}({body.joint})") for body in bodies[2:] for axis in "xyz"]
value, half, true = 1e3 * fit.theta[at], 1.96e3 * np.sqrt(np.diag(fit.covariance)[at]), shifts.ravel()
inside = np.abs(value - true) < half
print(f"{inside.sum()} of {len(at)} intervals contain the truth, {np.sum(half < 0.196)} known to 0.1 mm")

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle("Where an arm's joints lie, from torques and poses of its tool")
lengths = {"x of elbow": "length of the upper arm", "x of wrist": "length of the forearm"}
rows = [lengths.get(name := f"{axis} of {body.joint}", name) for body in bodies[2:] for axis in "xyz"]
panel.axvspan(-1.96 * stated, 1.96 * stated, color="0.92", label="95 % as stated")
panel.errorbar(value, rows, xerr=half, fmt="o", color="C0", capsize=3, label="estimate, 95 %")
panel.plot(true, rows, "x", color="C1", mew=2, zorder=3, label="truth")
panel.set(xlabel="displacement along an axis of the parent's frame (mm)")
panel.invert_yaxis()
figure.legend(loc="outside lower center", ncols=3)
