# # Your own arm
#
# This tutorial goes from the log of a force-torque sensor under an arm's base to a corrected model of the arm. You
# need a model, from the manufacturer or a drawing. The arm is simulated here, so that the true values are known at
# the end; with your own files you only need the sections from *The log* on. The page runs as it stands.

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc

# ## The model
#
# An MJCF file; URDF works as well. Its masses may be inaccurate.

MODEL = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <worldbody>
    <body name="column">
      <inertial pos="0 0 0.1" mass="6" diaginertia="0.05 0.05 0.02"/>
      <body name="shoulder" pos="0 0 0.3">
        <joint name="turn" axis="0 0 1" range="-2.5 2.5"/>
        <inertial pos="0 0 0.05" mass="3" diaginertia="0.02 0.02 0.01"/>
        <body name="upper" pos="0 0 0.1">
          <joint name="lift" axis="0 1 0" range="-1.5 1.5"/>
          <inertial pos="0.02 0 0.2" mass="4" diaginertia="0.06 0.06 0.01"/>
          <body name="fore" pos="0 0 0.4">
            <joint name="bend" axis="0 1 0" range="-2.2 2.2"/>
            <inertial pos="0 0 0.15" mass="2" diaginertia="0.02 0.02 0.004"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
Path("arm.xml").write_text(MODEL)
arm = mc.mechanism("arm.xml", base="column")
print(arm.tree.joints, f"{arm.mass:.1f} kg")

# ## What is identifiable?
#
# This is known before any measurement: it follows from the structure and from the measured channels.

base = mc.find_base_parameters(arm)
print(f"{base.rank} of {len(arm.known)}:", ", ".join(base.expressions(3)))

# Bodies are counted from 1 here: body 1 is the column, 4 the forearm.
#
# ## The arm that was built
#
# This section simulates the measurement. The forearm carries a tool of 0.8 kg that the model does not have, and the
# upper arm is lighter. The sensor under the base has noise and is 12 ms late, and the encoders have noise of a tenth
# of a degree.

built = MODEL.replace('mass="4"', 'mass="3.6"').replace(
    '<inertial pos="0 0 0.15" mass="2" diaginertia="0.02 0.02 0.004"/>',
    '<inertial pos="0.01 0 0.2" mass="2.8" diaginertia="0.035 0.035 0.006"/>',
)
Path("built.xml").write_text(built)
truth = mc.mechanism("built.xml", base="column")
rng, time = np.random.default_rng(1), np.arange(0, 12, 0.01)
sizes, frequencies = rng.uniform(0.2, 0.5, (3, 3)), rng.uniform(0.15, 0.9, (3, 3))
phases = rng.uniform(0, 6, (3, 3))


def motion(t):
    """Joint angles and their derivatives at times (N,): sums of sines."""
    w = 2 * np.pi * frequencies
    angle = w * t[:, None, None] + phases
    return [(sizes * x).sum(axis=2) for x in (np.sin(angle), w * np.cos(angle), -w * w * np.sin(angle))]


wrench = mc.base_wrench_regressor(truth.tree, *motion(time - 0.012), gravity=truth.gravity) @ truth.known
wrench += rng.normal(size=wrench.shape) * [0.5, 0.5, 0.5, 0.05, 0.05, 0.05]
angles = np.degrees(motion(time)[0]) + 0.1 * rng.normal(size=(len(time), 3))
header = "t [s],axis 1 [deg],axis 2 [deg],axis 3 [deg],FX,FY,FZ,MX,MY,MZ"
np.savetxt("run.csv", np.column_stack([time, angles, wrench]), delimiter=",", header=header, comments="", fmt="%.6f")

# ## The log
#
# A file as a controller writes it, with its own column names. A second file says what the columns are;
# `multicontact columns arm.xml run.csv --base column` drafts it.

Path("run.toml").write_text("""
time = "t [s]"
[joints.turn]
position = { column = "axis 1 [deg]", unit = "deg" }
[joints.lift]
position = { column = "axis 2 [deg]", unit = "deg" }
[joints.bend]
position = { column = "axis 3 [deg]", unit = "deg" }
[wrenches.ground]
force = ["FX", "FY", "FZ"]
torque = ["MX", "MY", "MZ"]
""")
recording = mc.read_log("run.csv", arm, "run.toml")
print(f"{len(recording.time)} samples at {recording.rate:.0f} Hz:", ", ".join(recording.measured))

# ## The estimate
#
# Only angles and wrench are used. Nothing is filtered and no cut-off is chosen: the trajectory is estimated together
# with the parameters. The last two fifths of the recording are held out.

estimate = mc.identify(arm, recording)
print(estimate.summary())

# `s.d.` comes from the noise. `set-up` adds the uncertainty of the set-up: a plate that may be off by some
# millimetres and degrees makes some parameters less certain, and more data do not help.
#
# ## Can it be trusted?

print(*(f"- {finding.text}" for finding in estimate.findings), sep="\n")

# The delay was detected and corrected. To see the effect of an uncorrected delay, try
# `mc.identify(arm, recording, setup={"delay": 0})`. The mass on the forearm, which the model does not have,
# shows in the model's residuals on the held-out part (over the standard deviation of each channel):

ratios = {"the model as it came": estimate.rivals["model"], "the estimate": estimate.held_out.ratio}
for name, ratio in ratios.items():
    print(f"{name:>21}: " + ", ".join(f"{c} {x:.2f}" for c, x in zip(estimate.channels, ratio, strict=True)))

figure, panel = plt.subplots(figsize=(8, 4), layout="constrained")
figure.suptitle("Errors in standard deviations")
error = estimate.psi - estimate.base.regroup(truth.known)
before = estimate.base.regroup(arm.known) - estimate.base.regroup(truth.known)
position = np.arange(base.rank)
panel.bar(position - 0.2, before / estimate.std_setup, 0.4, color="0.7", label="model as it came")
panel.bar(position + 0.2, error / estimate.std_setup, 0.4, color="C0", label="estimate")
panel.axhspan(-2, 2, color="C0", alpha=0.15, label="95 %")
panel.set_xticks(position, estimate.base.names, rotation=60)
panel.set_ylabel("error / s.d. with set-up")
panel.set_yscale("symlog", linthresh=3)
panel.legend()

# The true values are known here, and the intervals cover them.
#
# ## The updated model
#
# Base parameters are not yet a model. The physically consistent bodies that have these base parameters and are closest
# to the model's are written. Their intervals include all physical bodies that the estimate allows:

bodies = estimate.consistent()
print(bodies)
mc.write_model("arm_identified.xml", arm, bodies)
written = mc.mechanism("arm_identified.xml", base="column")
for name, was, now, true in zip(arm.bodies, *(x.known.reshape(-1, 10) for x in (arm, written, truth)), strict=True):
    print(f"{name:>8}: {was[0]:.2f} kg in the model, {now[0]:.2f} kg identified, {true[0]:.2f} kg built")

# The sensor measures sums of these masses. A sum is split among the bodies as in the model, unless the
# data contradict that; here they do where the arm was built differently.
#
# On the command line all of this is
#
# ```sh
# multicontact columns arm.xml run.csv --base column
# multicontact identify arm.xml run.csv --base column --columns run.toml
# ```
#
# with tables, figures and a page. [Recordings](../recordings.md) describes what else a log may contain,
# [the verdict](../verdict.md) what the sentences mean.
