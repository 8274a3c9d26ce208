# # A model that moves as the robot does
#
# Angles simulated with the recorded commands, less the recorded angles: by the model as it came and by the updated one.

import matplotlib.pyplot as plt
import mujoco
import numpy as np

import multicontact as mc
from ident.recordings.stated import model_servo
from sim.simulation.commanded import rolled_out

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
