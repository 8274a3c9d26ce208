# # The paper in ten minutes
#
# Matthew, Venture and Bajcsy derive a dynamic identification model from home poses and joint twists instead of
# Denavit-Hartenberg tables, so that a joint axis may point anywhere. They show the benefit on a double
# pendulum: if its axes are tilted by 5° and the model's are not, the estimate is wrong, and the usual checks do not
# show it. This page repeats that with the scenes and functions of this project. It runs as it stands.

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc
from sim.motion.excitation import DOUBLE_PENDULUM

# ## What is identifiable
#
# The mechanism as designed: a base, two links, both axes along X. It has 3 bodies with 10 parameters each. A force
# and torque sensor below the base determines 13 combinations of them, which follow from the geometry alone; the names
# are those of the paper's tables.

drawn = mc.mechanism(mc.scenes.load("double_pendulum"), base="base")
base = mc.find_base_parameters(drawn)
print(f"{len(drawn.known)} parameters, {base.rank} base parameters:", *base.expressions(4), sep="\n  ")

# ## A recording
#
# The pendulum as built has its axes tilted by 5°. MuJoCo's servos drive it along the excitation; joint states,
# the wrench under the base and the poses of the links are measured with noise, 943 times at 100 Hz as in the paper.

recording = mc.simulate(mc.scenes.load("double_pendulum", tilt_deg=5, azimuth_deg=120), DOUBLE_PENDULUM)
print(", ".join(recording.measured))

# ## The simplified model
#
# Its axes stay along X. Least squares (the paper's Eq. 4) estimate the base parameters from the wrench; the simulation
# provides the true ones.


def fitted(mechanism, names=None):
    """Least squares on a mechanism, with given names of base parameters or its own."""
    parameters = mc.find_base_parameters(mechanism, kept=names)
    return mc.least_squares(mc.Equations(mechanism, parameters), recording)


simplified = fitted(drawn)
error = simplified.psi - base.regroup(drawn.known)
for name, value in zip(simplified.names, error, strict=True):
    print(f"{name:6} {value:6.2f} {'<- wrong' if abs(value) > 0.3 else ''}")

# These are the large errors of the paper's Table III. Now the two usual checks, the condition number of the
# regressor and the residual relative to the wrench:

measured = recording.wrench("ground").values
print(f"condition number {simplified.condition_number:.1f}")
print(f"residual {simplified.epsilon / np.linalg.norm(measured):.1%} of the wrench")

# Both look good. Most of the wrench is weight, which even a wrong model explains.
#
# ## The axes, from poses
#
# The poses of the links determine the axes. Two axes recovered separately are never exactly parallel; a test
# decides whether they are treated as one direction.

arms = [np.broadcast_to(np.eye(4), (len(recording.time), 4, 4)), recording.poses("link1"), recording.poses("link2")]
recovered = mc.recover_axes(drawn.tree, np.stack(arms, axis=1))
axis = recovered.axes[0].vector
print(f"{np.degrees(np.arccos(axis[0])):.2f}° from X; parallel with p = {recovered.p_values[1]:.2f}")

# ## The full model
#
# In the geometric form only the twists change.

built = replace(drawn, tree=recovered.tree)
full = fitted(built, names=base.names)
truth = mc.find_base_parameters(built, kept=base.names).regroup(drawn.known)
print(f"largest error: simplified {abs(error).max():.2f}, full {abs(full.psi - truth).max():.2f}")
print(f"condition number on its own columns {fitted(built).condition_number:.1f}")

# The right model has the larger condition number ([why that means nothing](condition_number.md)). The single
# channels show what the sum of all residuals hides:

figure, panels = plt.subplots(3, 2, figsize=(9, 6), sharex=True, layout="constrained")
figure.suptitle("Recovered base wrench")
motion = mc.Motion(*recording.joint_states(drawn.tree.joints))
for k, (panel, channel) in enumerate(zip(panels.T.flat, ("Fx", "Fy", "Fz", "τx", "τy", "τz"), strict=True)):
    panel.plot(recording.time, measured[:, k], color="0.6", label="measured")
    panel.plot(recording.time, simplified.predicted(motion)[:, k], color="C1", label="axes along X")
    panel.plot(recording.time, full.predicted(motion)[:, k], color="C0", linestyle="--", label="axes recovered")
    panel.set_ylabel(f"{channel}, {'N' if k < 3 else 'N m'}")
panels[0, 0].legend(fontsize="small")
figure.supxlabel("time, s")

# ## A second contact
#
# In Section VII the end of the second link touches something. A load cell there measures the wrench that the link
# exerts on its surroundings, and Eq. 17 subtracts it from the ground's wrench.

scene = mc.scenes.load("double_pendulum", contact="pad")
touching = mc.mechanism(scene, base="base")
touched = mc.simulate(scene, DOUBLE_PENDULUM)
cell = mc.Sensor(*touching.site("contact"), applied_to_link=False)
felt = touched.with_sensors({"contact": cell})
states = mc.Motion(*touched.joint_states(touching.tree.joints))
equations = mc.Equations(touching, mc.find_base_parameters(touching))
for name, ignored in {"ignored": ["contact"], "measured": []}.items():
    total = felt.total_wrench(touching.tree, ignored).in_base
    fit = mc.least_squares(equations, mc.Samples(states, total))
    print(f"contact {name}: largest error {abs(fit.psi - fit.parameters.regroup(touching.known)).max():.2f}")

# ## Noise
#
# Least squares treated the measured accelerations as exact. `mc.identify` does not: it also estimates the
# trajectory, from angles and wrenches, and errors of the set-up. It is not given the tilt, but detects it: 5° towards
# 120° are 4.3° about y and 2.5° about z. No data can show whether the axes or the plate are tilted.

estimate = mc.identify(drawn, recording)
print(*(finding.text for finding in estimate.setup), sep="\n")

# [The paper's numbers and ours](../study.md) has all tables, [Reproduction](../reproduction.md) all errata.
