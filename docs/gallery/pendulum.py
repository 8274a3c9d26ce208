# # A held double pendulum
#
# Postures of the paper's double pendulum while a hand holds its end, with the forces of ground and hand.

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc
from sim.motion.excitation import DOUBLE_PENDULUM

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
