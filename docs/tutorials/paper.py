# # The paper in ten minutes
#
# Matthew, Venture and Bajcsy derive a dynamic identification model from home poses and joint twists instead of
# Denavit-Hartenberg tables, so that a joint axis may point anywhere. They show what that is worth on a double
# pendulum: if its axes are tilted by 5° and the model's are not, the estimate is wrong, and the usual checks do not
# notice. This page does so with the scenes and functions of this project. It runs as it stands.

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import ident
import scenes
import sim
from sim.motion.excitation import DOUBLE_PENDULUM

# ## What can be known
#
# The mechanism as it was drawn: a base, two links, both axes along X. It has 3 bodies with 10 parameters each. A force
# and torque sensor below the base sees 13 combinations of them, which follow from the geometry alone; the names are
# those of the paper's tables.

drawn = sim.mechanism(scenes.load("double_pendulum"), base="base")
base = ident.find_base_parameters(drawn)
print(f"{len(drawn.known)} parameters, {base.rank} base parameters:", *base.expressions(4), sep="\n  ")

# ## A recording
#
# The pendulum that was built has its axes tilted by 5°. MuJoCo's servos drive it along the excitation; joint states,
# the wrench under the base and the poses of the links are measured with noise, 943 times at 100 Hz as in the paper.

recording = sim.simulate(scenes.load("double_pendulum", tilt_deg=5, azimuth_deg=120), DOUBLE_PENDULUM)
print(", ".join(recording.measured))

# ## The simplified model
#
# Its axes stay along X. Least squares (the paper's Eq. 4) find the base parameters from the wrench; the simulation
# knows the true ones.


def fitted(mechanism, names=None):
    """Least squares on a mechanism, with given names of base parameters or its own."""
    parameters = ident.find_base_parameters(mechanism, kept=names)
    return ident.least_squares(ident.Equations(mechanism, parameters), recording)


simplified = fitted(drawn)
error = simplified.psi - base.regroup(drawn.known)
for name, value in zip(simplified.names, error, strict=True):
    print(f"{name:6} {value:6.2f} {'<- wrong' if abs(value) > 0.3 else ''}")

# These are the large errors of the paper's Table III. Now the two checks that are usual, the condition number of the
# regressor and the residual over the wrench:

measured = recording.wrench("ground").values
print(f"condition number {simplified.condition_number:.1f}")
print(f"residual {simplified.epsilon / np.linalg.norm(measured):.1%} of the wrench")

# Both look well. Most of the wrench is weight, which is easily explained.
#
# ## The axes, from poses
#
# The poses of the links tell where the axes are. Two axes recovered one by one are never exactly parallel; whether
# they may be one direction is decided by a test.

arms = [np.broadcast_to(np.eye(4), (len(recording.time), 4, 4)), recording.poses("link1"), recording.poses("link2")]
recovered = ident.recover_axes(drawn.tree, np.stack(arms, axis=1))
axis = recovered.axes[0].vector
print(f"{np.degrees(np.arccos(axis[0])):.2f}° from X; parallel with p = {recovered.p_values[1]:.2f}")

# ## The full model
#
# In the geometric form only the twists change.

built = replace(drawn, tree=recovered.tree)
full = fitted(built, names=base.names)
truth = ident.find_base_parameters(built, kept=base.names).regroup(drawn.known)
print(f"largest error: simplified {abs(error).max():.2f}, full {abs(full.psi - truth).max():.2f}")
print(f"condition number on its own columns {fitted(built).condition_number:.1f}")

# The model that is right has the larger condition number ([why that means nothing](condition_number.md)). Channel by
# channel one sees what the sum of all residuals hides:

figure, panels = plt.subplots(3, 2, figsize=(9, 6), sharex=True, layout="constrained")
figure.suptitle("Recovered base wrench")
motion = ident.Motion(*recording.joint_states(drawn.tree.joints))
for k, (panel, channel) in enumerate(zip(panels.T.flat, ("Fx", "Fy", "Fz", "τx", "τy", "τz"), strict=True)):
    panel.plot(recording.time, measured[:, k], color="0.6", label="measured")
    panel.plot(recording.time, simplified.predicted(motion)[:, k], color="C1", label="axes along X")
    panel.plot(recording.time, full.predicted(motion)[:, k], color="C0", linestyle="--", label="axes recovered")
    panel.set_ylabel(f"{channel}, {'N' if k < 3 else 'N m'}")
panels[0, 0].legend(fontsize="small")
figure.supxlabel("time, s")

# ## A second contact
#
# Section VII lets the end of the second link touch something. A load cell there measures what the link exerts on its
# surroundings, and Eq. 17 takes that off the ground's wrench.

scene = scenes.load("double_pendulum", contact="pad")
touching = sim.mechanism(scene, base="base")
touched = sim.simulate(scene, DOUBLE_PENDULUM)
cell = ident.Sensor(*touching.site("contact"), applied_to_link=False)
felt = touched.with_sensors({"contact": cell})
states = ident.Motion(*touched.joint_states(touching.tree.joints))
equations = ident.Equations(touching, ident.find_base_parameters(touching))
for name, ignored in {"ignored": ["contact"], "measured": []}.items():
    total = felt.total_wrench(touching.tree, ignored).in_base
    fit = ident.least_squares(equations, ident.Samples(states, total))
    print(f"contact {name}: largest error {abs(fit.psi - fit.parameters.regroup(touching.known)).max():.2f}")

# ## And noise
#
# Least squares took the measured accelerations for exact. `ident.identify` does not: it estimates the trajectory too,
# from angles and wrenches, and what is off in the set-up. It does not know of the tilt, and finds it: 5° towards 120°
# are 4.3° about y and 2.5° about z, of which no data tell whether it was the axes or the plate.

estimate = ident.identify(drawn, recording)
print(*(finding.text for finding in estimate.setup), sep="\n")

# [The paper's numbers against ours](../study.md) has all tables, [Reproduction](../reproduction.md) all errata.
