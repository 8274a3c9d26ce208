# # Mechanisms and what they exert
#
# Poses, wrenches and parameters of mechanisms, known or simulated.

from math import pi

import matplotlib.pyplot as plt
import mujoco
import numpy as np

import multicontact as mc
from ident.recordings.stated import model_servo
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.stepped import rolled_out

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

# ## A model that moves as the robot does
#
# Angles simulated with the recorded commands, less the recorded angles: by the model as it came and by the updated one.

INERTIAL = '<inertial pos=".2 0 0" mass="{3}" diaginertia=".01 .03 .03"/>'
BODY = '<body pos="{0} 0 0"><joint name="{1}" axis="0 1 0" {2}/>' + INERTIAL
SERVOS = '<actuator><position joint="lift" kp="120" kv="6"/><position joint="bend" kp="50" kv="2.5"/></actuator>'


def spec(lift, bend):
    """An arm of two links, from the drive of each joint and the mass of its link."""
    links = BODY.format(0, "lift", *lift) + BODY.format(0.4, "bend", *bend) + "</body></body>"
    return mujoco.MjSpec.from_string(f"<mujoco><worldbody>{links}</worldbody>{SERVOS}</mujoco>")


drives = 'damping="1.2" frictionloss="1" armature=".12"', 'damping=".5" frictionloss=".4" armature=".05"'
robot = spec((drives[0], 2.4), (drives[1], 1.5)).compile()
robot.opt.timestep = 0.001
data, rng, time = mujoco.MjData(robot), np.random.default_rng(1), np.arange(0, 10, 0.01)
frequencies, phases = rng.uniform(0.2, 1.2, (2, 4)), rng.uniform(0, 6, (2, 4))
commands = 0.2 * np.sin(2 * np.pi * frequencies * time[:, None, None] + phases).sum(axis=2)
data.qpos[:], angles = commands[0], []
for data.ctrl[:] in commands:
    angles.append(data.qpos + 1e-4 * rng.normal(size=2))
    mujoco.mj_step(robot, data, 10)

guess = 'damping=".1" frictionloss=".1" armature=".01"'
arm = mc.mechanism(spec((guess, 2), (guess, 2)))
channels = {f"{joint}_position": q for joint, q in zip(arm.joints, np.transpose(angles), strict=True)}
channels |= {f"{joint}_command": u for joint, u in zip(arm.joints, commands.T, strict=True)}
servos = {joint: model_servo(arm, joint) for joint in arm.joints}
recording = mc.Recording(time, channels, servos=servos)
estimate = mc.identify(arm, recording)
updated = {"phi": estimate.consistent().phi, "drives": estimate.drives_updated}
followed = {"model as it came": rolled_out(arm, recording), "updated model": rolled_out(arm, recording, **updated)}

figure, panels = plt.subplots(2, figsize=(6, 4), sharex=True, layout="constrained")
figure.suptitle("Simulated less recorded joint angles")
for (name, q), color in zip(followed.items(), ("0.6", "C0"), strict=True):
    error = 1e3 * (q - np.array(angles))
    print(f"{name}: {np.sqrt(np.mean(error**2)):.1f} mrad")
    for panel, joint, values in zip(panels, arm.joints, error.T, strict=True):
        panel.plot(time, values, color=color, label=name)
        panel.set_ylabel(f"{joint} (mrad)")
panels[0].legend(ncols=2)
panels[1].set_xlabel("time (s)")
