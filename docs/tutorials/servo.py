# # A robot that logs commands
#
# Many robots are position-controlled: their logs hold commanded and measured joint angles, and no torque. This tutorial
# goes from such a log to a model that moves as the robot does. The robot is simulated here, so that its drives are
# known at the end; with your own files you only need the sections from *The log* on. The page runs as it stands.

from pathlib import Path

import matplotlib.pyplot as plt
import mujoco
import numpy as np

import multicontact as mc
from sim.simulation.stepped import rolled_out

# ## The model
#
# Three joints with position actuators, whose gains the manufacturer states. Friction and rotor inertias are guesses.

MODEL = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <default>
    <joint damping="0.1" frictionloss="0.1" armature="0.01"/>
  </default>
  <worldbody>
    <body name="shoulder" pos="0 0 0.3">
      <joint name="turn" axis="0 0 1"/>
      <inertial pos="0 0 0.05" mass="3" diaginertia="0.02 0.02 0.01"/>
      <body name="upper" pos="0 0 0.1">
        <joint name="lift" axis="0 1 0"/>
        <inertial pos="0.02 0 0.2" mass="3" diaginertia="0.05 0.05 0.01"/>
        <body name="fore" pos="0 0 0.4">
          <joint name="bend" axis="0 1 0"/>
          <inertial pos="0 0 0.15" mass="1.5" diaginertia="0.02 0.02 0.004"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="turn" kp="80" kv="4"/>
    <position joint="lift" kp="120" kv="6"/>
    <position joint="bend" kp="50" kv="2.5"/>
  </actuator>
</mujoco>
"""
Path("arm.xml").write_text(MODEL)
arm = mc.mechanism("arm.xml")
joints = arm.tree.joints

# ## The robot
#
# This section simulates the recording. The robot's joints rub and have geared rotors. Commands are sums of sines at
# 100 Hz, and each is held until the next one. Encoders have noise of 0.1 mrad.

drives = {"turn": (0.9, 0.8, 0.15), "lift": (1.2, 1.0, 0.12), "bend": (0.5, 0.4, 0.05)}
robot = MODEL
for joint, (damping, friction, rotor) in drives.items():
    stated = f'damping="{damping}" frictionloss="{friction}" armature="{rotor}"'
    robot = robot.replace(f'<joint name="{joint}"', f'<joint name="{joint}" {stated}')
model = mujoco.MjModel.from_xml_string(robot)
model.opt.timestep = 0.001
data, rng, time = mujoco.MjData(model), np.random.default_rng(1), np.arange(0, 15, 0.01)
frequencies, phases = rng.uniform(0.2, 1.2, (3, 4)), rng.uniform(0, 6, (3, 4))
sizes = rng.uniform(0.1, 0.3, (3, 4))
commands = (sizes * np.sin(2 * np.pi * frequencies * time[:, None, None] + phases)).sum(axis=2)
data.qpos[:], angles = commands[0], []
for command in commands:
    angles.append(data.qpos.copy())
    data.ctrl[:] = command
    mujoco.mj_step(model, data, 10)
angles = np.array(angles) + 1e-4 * rng.normal(size=commands.shape)
header = "time,q1,q2,q3,u1,u2,u3"
np.savetxt("run.csv", np.column_stack([time, angles, commands]), delimiter=",", header=header, comments="", fmt="%.6f")

# ## The log
#
# A second file says which columns are angles and which are commands. The gains are those of the model's actuators;
# `kp` and `kv` beside a command would replace them.

Path("run.toml").write_text(
    "".join(f'[joints.{joint}]\nposition = "q{k}"\ncommand = "u{k}"\n' for k, joint in enumerate(joints, start=1))
)
recording = mc.read_log("run.csv", arm, "run.toml")
print(*(f"{joint}: {servo}" for joint, servo in recording.servos.items()), sep="\n")

# ## The estimate
#
# A command stands in for a torque, `kp (u - q) - kv q̇`, with angles and velocities of the estimated trajectory, so
# that nothing has to be filtered; each command is held until the next one. Friction and rotor inertias are estimated
# with the links.

estimate = mc.identify(arm, recording)
print(*(f"- {finding.text}" for finding in estimate.findings), sep="\n")

deviations = np.sqrt(np.diag(estimate.covariance_setup))
values = zip(estimate.fit.names, estimate.fit.values, deviations, strict=True)
shown = {name: (value, std) for name, value, std in values if name.startswith(("Ia", "Fv", "Fc"))}
for joint, true in drives.items():
    for column, number in zip(("Fv", "Fc", "Ia"), true, strict=True):
        if (name := f"{column}({joint})") in shown:
            value, std = shown[name]
            print(f"{name:>9}: {value:.3f} ± {2 * std:.3f}, true {number:.3f}")

# The rotors of the first two joints cannot be separated from the links' inertias about the same axes, so they are not
# in the list; what they add is part of the base parameters.
#
# ## A model that moves as the robot
#
# The updated model has the identified bodies and drives. Simulated with the recorded commands, it follows the robot:

mc.write_model("arm_identified.xml", arm, estimate.consistent(), estimate.drives_updated)
updated = mc.mechanism("arm_identified.xml")
lag = next((each.value for each in estimate.setup if each.name == "lag"), 0.0)
followed = {"model as it came": rolled_out(arm, recording), "updated model": rolled_out(updated, recording, lag=lag)}
figure, panels = plt.subplots(3, figsize=(8, 5), sharex=True, layout="constrained")
for k, (joint, panel) in enumerate(zip(joints, panels, strict=True)):
    for (name, q), color in zip(followed.items(), ("0.6", "C0"), strict=True):
        error = 1e3 * (q - angles)[:, k]
        panel.plot(time, error, color=color, label=f"{name}, RMS {np.sqrt((error**2).mean()):.1f} mrad")
    panel.set_ylabel(f"{joint}\nerror (mrad)")
    panel.legend(loc="upper right", fontsize="small")
panels[-1].set_xlabel("time (s)")

# On the command line all of this is
#
# ```sh
# multicontact identify arm.xml run.csv --columns run.toml
# ```
#
# with tables, figures, the simulated errors on the held-out part, and the updated model.
# [Laboratory files](../laboratory_files.md#commands-of-position-controlled-joints) has the details.
