# # Friction at reversals
#
# What the links do not explain of an elbow's torque: it jumps with the sign of the velocity, and grows with it.

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc

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
