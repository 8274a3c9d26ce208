# # Why not to trust a condition number
#
# A condition number bounds how much least squares amplify noise, for the columns it was computed from. It is often used
# to rate a model or an experiment. Five small experiments on the paper's double pendulum show why that fails.
# The page runs as it stands.

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc
from sim.motion.excitation import DOUBLE_PENDULUM, Excitation

drawn = mc.mechanism(mc.scenes.load("double_pendulum"), base="base")
tilted = mc.scenes.load("double_pendulum", tilt_deg=5, azimuth_deg=120)
built = mc.mechanism(tilted, base="base")
recording = mc.simulate(tilted, DOUBLE_PENDULUM)


def fitted(mechanism, names=None, log=recording):
    """Least squares on a mechanism, with given names of base parameters or its own."""
    return mc.least_squares(mc.Equations(mechanism, mc.find_base_parameters(mechanism, kept=names)), log)


def largest_error(fit):
    """Of the base parameters, against the true ones."""
    return abs(fit.psi - fit.parameters.regroup(drawn.known)).max()


# ## 1. A wrong model can have the smaller condition number
#
# The pendulum's axes are tilted by 5°. One model has them along X, the other as they are.

wrong, right = fitted(drawn), fitted(built)
for name, fit in {"axes along X": wrong, "axes as they are": right}.items():
    print(f"{name}: condition number {fit.condition_number:.0f}, largest error {largest_error(fit):.2f}")

# The condition number depends on the regressor, that is on the motion and the model, but not on the measured wrench.
# So it cannot show whether the model is right.
#
# ## 2. It depends on the choice of base parameters
#
# The same regressor has many bases. With tilted axes the first independent columns differ from those without tilt, and
# some of them are nearly dependent. With the simplified model's choice of base parameters, the same model is as well
# conditioned as the simplified one, and predicts the same wrench as before.

renamed = fitted(built, names=wrong.parameters.names)
motion = mc.Motion(*recording.joint_states(drawn.tree.joints))
difference = abs(renamed.predicted(motion) - right.predicted(motion)).max()
print(f"condition numbers {right.condition_number:.0f} and {renamed.condition_number:.1f}")
print(f"largest difference of the predicted wrenches {difference:.0e} N or N m")

# ## 3. It depends on the units
#
# From metres to millimetres, only the condition number changes.

Y = right.parameters.reduce(mc.base_wrench_regressor(built.tree, *motion.states, gravity=built.gravity))
Y = Y.reshape(-1, right.parameters.rank)
power = np.array([0 if "r" not in name and "I" not in name else 1 + name.startswith("I") for name in right.names])
for unit, length in {"m": 1.0, "mm": 1e-3}.items():
    print(f"lengths in {unit}: {np.linalg.cond(Y * length**power):.3g}")

# ## 4. The smallest one is not the best experiment
#
# The goal is small standard deviations of the parameters of interest. Of forty random motions, the one
# with the smallest condition number is not the one with the smallest standard deviations.

rng = np.random.default_rng(0)
time = np.arange(0, 9.43, 0.02)
noise = np.array([0.5, 0.5, 0.5, 0.05, 0.05, 0.05])
base = mc.find_base_parameters(drawn)
conditions, deviations = [], []
for _ in range(40):
    size, frequency, phase = rng.uniform(0.5, 4, (2, 2)), rng.uniform(0.2, 0.9, (2, 2)), rng.uniform(0, 6, (2, 2))
    states = Excitation(np.array([-1.0, 1.1]), size, frequency, phase).trajectory(time)
    columns = base.reduce(mc.base_wrench_regressor(drawn.tree, *states, gravity=drawn.gravity))
    conditions.append(np.linalg.cond(columns.reshape(-1, base.rank)))
    weighted = (columns / noise[:, None]).reshape(-1, base.rank)
    deviations.append(np.exp(np.log(np.diag(np.linalg.inv(weighted.T @ weighted))).mean() / 2))
by_condition, by_deviation = np.argmin(conditions), np.argmin(deviations)
ratio = deviations[by_condition] / deviations[by_deviation]
print(f"best conditioned: {conditions[by_condition]:.0f}, deviations {ratio:.2f} times as large as the best motion's")
print(f"best motion: condition number {conditions[by_deviation]:.0f}")

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle("Forty motions by chance")
panel.loglog(conditions, deviations, "o", color="C0")
panel.loglog(conditions[by_condition], deviations[by_condition], "s", color="C1", label="best conditioned")
panel.loglog(conditions[by_deviation], deviations[by_deviation], "D", color="C2", label="smallest deviations")
panel.set(xlabel="condition number", ylabel="geometric mean of the standard deviations\n(kg, kg m, kg m²)")
panel.legend()

# `multicontact excite` therefore designs motions by their standard deviations
# ([excitation design](../excitation.md)).
#
# ## 5. It ignores noise on the joints
#
# The same motion, measured with ten times the noise on the joint states: the condition number gets smaller, since noise
# makes the columns less similar. Least squares, which treat the states as exact, are off by many of their own standard
# deviations.

flawless = replace(recording.noise_free, noise=recording.noise)
states = [f"{joint}_{kind}" for joint in drawn.tree.joints for kind in ("position", "velocity", "acceleration")]
for scale in (1, 10):
    noisy = {x: flawless[x] + scale * recording.noise[x] * rng.normal(size=len(recording.time)) for x in states}
    log = replace(flawless, measured={**flawless.measured, **noisy})
    fit = fitted(built, wrong.parameters.names, log)
    k = fit.names.index("Ixx2")
    off = fit.psi[k] - fit.parameters.regroup(drawn.known)[k]
    print(f"noise ×{scale}: condition number {fit.condition_number:.1f}, Ixx2 off by {off:.2f} ± {fit.std[k]:.2f}")

# ## What to look at instead
#
# - Residuals of each channel, relative to its standard deviation, on data that were not fitted.
# - The prediction of the original model on the same data: is the estimate any better?
# - The standard deviation of each parameter, with verified coverage.
# - Two recordings, or two halves of one: do they agree within these standard deviations?
#
# The [verdict](../verdict.md) reports these.
