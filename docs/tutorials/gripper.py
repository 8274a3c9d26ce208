# # A gripper on a wrist
#
# A parallel gripper has loops: one motor moves two fingers, each of which a second link keeps parallel. This tutorial
# weighs such a gripper, with its fingers moving, from the force-torque sensor in the wrist that carries it. Only the
# arm's joints and the gripper's motor are logged. The robot is simulated here, so that the true masses are known at
# the end; with your own files you only need the sections from *The log* on. The page runs as it stands.

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc

# ## The model
#
# An MJCF file. Each finger is on a driver and pinned to a link behind it (`connect`), and the right driver turns as
# the left one (`joint`). In URDF, the second is a `<mimic>`; loops of pins have no place there.

SIDE = """
<body name="{side}_driver" pos="{x} 0 0.05">
  <joint name="{side}_driver" axis="0 {sign} 0" range="-0.6 0.6"/>
  <inertial mass="0.05" pos="0.01 0 0.02" diaginertia="3e-5 3e-5 1e-5"/>
  <body name="{side}_finger" pos="{pin} 0 0.04">
    <joint name="{side}_finger" axis="0 {sign} 0"/>
    <inertial mass="{mass}" pos="0 0 0.05" diaginertia="8e-5 8e-5 2e-5"/>
  </body>
</body>
<body name="{side}_link" pos="{behind} 0 0.06">
  <joint name="{side}_link" axis="0 {sign} 0"/>
  <inertial mass="0.03" pos="0.005 0 0.02" diaginertia="1e-5 1e-5 5e-6"/>
</body>
"""
ARM = """
<mujoco model="wrist">
  <compiler angle="radian"/>
  <worldbody>
    <body name="base">
      <inertial mass="5" pos="0 0 0.05" diaginertia="0.05 0.05 0.05"/>
      <body name="upper" pos="0 0 0.2">
        <joint name="lift" axis="0 1 0"/>
        <inertial mass="3" pos="0 0 0.15" diaginertia="0.03 0.03 0.01"/>
        <body name="fore" pos="0 0 0.3">
          <joint name="bend" axis="1 0 0"/>
          <inertial mass="2" pos="0 0 0.1" diaginertia="0.01 0.01 0.004"/>
          <body name="palm" pos="0 0 0.2">
            <joint name="roll" axis="0 0 1"/>
            <inertial mass="0.4" pos="0 0 0.03" diaginertia="4e-4 4e-4 3e-4"/>
            {sides}
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality>
    <connect name="left_pin" body1="left_finger" body2="left_link" anchor="0.015 0 0.01"/>
    <connect name="right_pin" body1="right_finger" body2="right_link" anchor="-0.015 0 0.01"/>
    <joint name="both" joint1="right_driver" joint2="left_driver"/>
  </equality>
  <actuator>
    <motor joint="left_driver"/>
  </actuator>
</mujoco>
"""


def model(finger):
    """The arm with fingers of a mass in kg."""
    both = (("left", -1), ("right", 1))
    places = [{"x": 0.02 * s, "pin": 0.03 * s, "behind": 0.005 * s, "sign": s, "side": side} for side, s in both]
    return ARM.format(sides="".join(SIDE.format(mass=finger, **place) for place in places))


Path("arm.xml").write_text(model(0.08))
arm = mc.mechanism("arm.xml", base="base")
print(arm)

# Of nine joints, five depend on the gripper's motor.
#
# ## The robot that was built
#
# This section simulates the recording: its fingers have rubber pads and weigh 130 g instead of 80. The arm's joints and
# the motor are logged with noise of 0.2 mrad, the wrench with noise of 0.05 N and 3 mN m.

Path("built.xml").write_text(model(0.13))
truth = mc.mechanism("built.xml", base="base").beyond("palm")
rng, time = np.random.default_rng(0), np.arange(0, 10, 0.01)
sizes = {"lift": (0.8, 0.3), "bend": (0.9, 0.3), "roll": (1.2, 0.4), "left_driver": (0.35, 0.12)}


def swing(joint):
    """Coordinate of a joint and its derivatives (N,): sums of two sines."""
    w = np.array([1.1, 2.9]) + 0.33 * list(sizes).index(joint)
    angle, a = np.outer(time, w) + w, np.array(sizes[joint])
    return [np.sin(angle) @ a, np.cos(angle) @ (a * w), -np.sin(angle) @ (a * w * w)]


states = {joint: swing(joint) for joint in sizes}
moving = truth.closed([joint for joint in truth.tree.joints if joint != "left_driver"])
base = truth.carrier.motion(*(np.stack([states[j][k] for j in truth.carrier.joints], axis=1) for k in range(3)))
driver = [x[:, None] for x in states["left_driver"]]
wrench = mc.base_wrench_regressor(moving.tree, *driver, gravity=moving.gravity, base=base) @ moving.known
wrench += rng.normal(size=wrench.shape) * [0.05, 0.05, 0.05, 0.003, 0.003, 0.003]
angles = [x[0] + 2e-4 * rng.normal(size=len(time)) for x in states.values()]
header = ",".join(("time", *states, "FX", "FY", "FZ", "MX", "MY", "MZ"))
np.savetxt("run.csv", np.c_[time, np.transpose(angles), wrench], delimiter=",", header=header, comments="", fmt="%.6f")

# ## The log
#
# `multicontact columns arm.xml run.csv --base base` drafts the second file, and notes which joints need no column.

Path("run.toml").write_text(
    "".join(f'[joints.{joint}]\nposition = "{joint}"\n' for joint in states)
    + '[wrenches.ground]\nforce = ["FX", "FY", "FZ"]\ntorque = ["MX", "MY", "MZ"]\n'
)
recording = mc.read_log("run.csv", arm, "run.toml")
print(f"{len(recording.time)} samples:", ", ".join(recording.measured))

# ## What is identifiable?
#
# The sensor carries what is beyond it: the palm and what is on it, `arm.beyond("palm")`; the arm's joints are its
# carrier, whose masses have no effect. In the wrench, the forces inside the loops cancel, so that kinematics alone
# close them. Base parameters are those of the closed gripper:

gripper = arm.beyond("palm")
closed = gripper.closed([joint for joint in gripper.tree.joints if joint != "left_driver"])
parts = mc.find_base_parameters(closed, sensors=mc.Sensors(moving_base=True))
print(f"{parts.rank} of {len(closed.known)}; the first is {parts.expressions(3)[0]}")

# ## The estimate

estimate = mc.identify(gripper, recording)
print(estimate.verdict())
true = estimate.base.regroup(truth.known)
mass = estimate["m1"]
print(f"mass of the gripper: {mass.value:.4f} ± {2 * mass.std:.4f} kg, true {truth.mass:.4f} kg")

figure, panel = plt.subplots(figsize=(8, 4), layout="constrained")
figure.suptitle("Errors in standard deviations")
position, before = np.arange(estimate.base.rank), estimate.base.regroup(gripper.known)
panel.bar(position - 0.2, (before - true) / estimate.std_setup, 0.4, color="0.7", label="model as it came")
panel.bar(position + 0.2, (estimate.psi - true) / estimate.std_setup, 0.4, color="C0", label="estimate")
panel.axhspan(-2, 2, color="C0", alpha=0.15, label="95 %")
panel.set_xticks(position, estimate.base.names, rotation=90, fontsize="x-small")
panel.set_ylabel("error / s.d. with set-up")
panel.set_yscale("symlog", linthresh=3)
panel.legend()

# ## The bodies

bodies = estimate.consistent()
phi = gripper.known, bodies.phi, truth.known
for name, was, now, built in zip(gripper.bodies, *(x.reshape(-1, 10) for x in phi), strict=True):
    print(f"{name:>13}: {was[0]:.3f} kg in the model, {now[0]:.3f} kg identified, {built[0]:.3f} kg built")

# A sum of masses is split among the bodies as in the model where the motion does not tell them apart.
#
# Of a mechanism that is identified as a whole, `mc.write_model` writes these bodies, and its drives, into the model's
# file; constraints stay there as they are.
#
# ## A gripper that holds still
#
# Weighed with its fingers at rest, the gripper is one body, and the command line does it all: mass, centre of mass and
# inertia, as a robot's controller wants them. `--fix` says where its motor stands, in rad; joints that depend on it
# rest as well.
#
# ```sh
# multicontact payload arm.xml held.csv --columns held.toml --base base --body palm --sensor wrist --fix left_driver 0.2
# ```
#
# [Loops](../models.md#loops) says which constraints are read, [payloads](../payload.md) what else is weighed.
