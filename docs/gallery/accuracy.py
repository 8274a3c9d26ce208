# # How accurate estimates are
#
# Intervals against truths, estimates against each other, and motions that say more.

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import welch

import multicontact as mc
from experiments.studies import designed_excitation
from sim.motion.excitation import BOWING, DOUBLE_PENDULUM

# ## Do intervals cover the truth?
#
# The 95 % intervals of one parameter from a hundred simulated recordings; those that miss the truth are marked.

spec = mc.scenes.load("double_pendulum")
equations = mc.Equations.of_wrench(mc.mechanism(spec, base="base"))
exact = mc.simulate(spec, DOUBLE_PENDULUM, samples=300, noise_scale=0)
motion = mc.Motion(*exact.joint_states(equations.mechanism.tree.joints))
wrench, rng = exact.wrench("ground").values, np.random.default_rng(1)
noise = np.array([0.5, 0.5, 0.5, 0.05, 0.05, 0.05])
noisy = [mc.Samples(motion, wrench + noise * rng.normal(size=wrench.shape)) for _ in range(100)]
fits = [mc.least_squares(equations, each) for each in noisy]
k = fits[0].names.index("m2rz2")
middle, half = np.array([fit.psi[k] for fit in fits]), 1.96 * np.array([fit.std[k] for fit in fits])
true = fits[0].parameters.regroup(equations.mechanism.known)[k]
misses = np.abs(middle - true) > half
print(f"{100 - misses.sum()} of 100 intervals contain the truth")

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle(f"{100 - misses.sum()} of 100 intervals contain the truth")
number = np.arange(100)
for chosen, color, label in ((~misses, "C0", "contains it"), (misses, "C3", "misses it")):
    panel.errorbar(number[chosen], middle[chosen], half[chosen], fmt=".", color=color, lw=1, ms=3, label=label)
panel.axhline(true, color="black", lw=1, label="true")
panel.set(xlabel="recording", ylabel="first moment of link 2, regrouped (kg m)")
panel.legend(loc="upper center", ncols=3, bbox_to_anchor=(0.5, 1.1), frameon=False)

# ## Do two recordings agree?
#
# Differences of two estimates in standard deviations: chance with the right model, far beyond it with a wrong one.

spec = mc.scenes.load("double_pendulum", tilt_deg=5, azimuth_deg=120)
other = replace(DOUBLE_PENDULUM, phase=[[1, 2], [3, 1]])
recordings = [mc.simulate(spec, motion) for motion in (DOUBLE_PENDULUM, other)]
right, wrong = mc.mechanism(spec, base="base"), mc.mechanism(mc.scenes.load("double_pendulum"), base="base")

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle("Difference of two recordings' estimates")
names = mc.find_base_parameters(wrong).names
for model, label, color, shift in ((wrong, "axes along X", "C1", -0.2), (right, "axes as they are", "C0", 0.2)):
    equations = mc.Equations(model, mc.find_base_parameters(model, kept=names))
    first, second = (mc.least_squares(equations, each) for each in recordings)
    z = (first.psi - second.psi) / np.hypot(first.std, second.std)
    print(f"{label}: root mean square {np.sqrt(np.mean(z**2)):.1f}")
    panel.bar(np.arange(len(z)) + shift, np.abs(z), 0.4, color=color, label=label)
panel.axhline(1.96, color="0.4", lw=1, ls="--", label="95 % by chance")
panel.set_yscale("symlog", linthresh=2)
panel.set_xticks(np.arange(len(names)), names, rotation=60)
panel.set_ylabel("|difference| / its s.d.")
figure.legend(loc="outside lower center", ncols=3)

# ## Spectra of residuals
#
# The right model leaves the white noise of the sensors; a wrong one leaves a moment at the frequencies of the motion.

spec = mc.scenes.load("double_pendulum", tilt_deg=5, azimuth_deg=120)
recording = mc.simulate(spec, DOUBLE_PENDULUM)
models = {"axes along X": mc.scenes.load("double_pendulum"), "axes as they are": spec}

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle(r"Spectra of $\tau_y$ and its residuals")
panel.loglog(*welch(recording["ground_torque"][:, 1], recording.rate, nperseg=512), color="0.6", label="measured")
for (name, each), color in zip(models.items(), ("C1", "C0"), strict=True):
    model = mc.mechanism(each, base="base")
    fit = mc.least_squares(mc.Equations.of_wrench(model), recording)
    motion = mc.Motion(*recording.joint_states(model.tree.joints))
    residual = recording["ground_torque"] - fit.predicted(motion)[:, 3:]
    panel.loglog(*welch(residual[:, 1], recording.rate, nperseg=512), color=color, label=f"residual, {name}")
    print(f"{name}: residual {residual[:, 1].std():.3f} N m")
panel.axhline(recording.noise["ground_torque"] ** 2 / (recording.rate / 2), color="black", ls="--", lw=1, label="noise")
panel.set(xlabel="frequency (Hz)", ylabel="density (N² m²/Hz)", xlim=(0.19, 50))
panel.legend()

# ## A designed motion against random ones
#
# Standard deviations of each base parameter with a motion made for them, and with twenty random ones within its limits.

problem = designed_excitation.problem_of("double_pendulum")
search = designed_excitation.DesignSearch(harmonics=4, starts=1, iterations=60)
design = designed_excitation.designed(problem, "double_pendulum", search)


def deviations(states):
    """Standard deviations of the base parameters by least squares on a motion (r,)."""
    rows = (problem.whitening @ problem.regressor(*states)).reshape(-1, len(problem.names))
    return np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))


rest, seconds = np.zeros(len(problem.joints)), float(design.time[-1])
motions = designed_excitation.start_motions(design.limits, rest, seconds, 4, 20, seed=1)
random = np.array([deviations(motion.states(design.time)) for motion in motions])
best = deviations(design.after.motion.states)
print(f"geometric mean over the random motions': {np.exp(np.log(best / random).mean()):.2f}")

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle("Standard deviations by motion")
panel.semilogy(random.T, "_", color="0.6", ms=9)
panel.semilogy([], "_", color="0.6", ms=9, label="random motions")
panel.semilogy(best, "D", color="C0", label="designed motion")
panel.set_xticks(np.arange(len(best)), problem.names, rotation=60)
panel.set_ylabel("s.d. (kg, kg m, kg m²)")
panel.legend()

# ## A person's segments
#
# Base parameters of a person who bows on a force plate, from angles with noise of half a degree, with 95 % intervals.

spec = mc.scenes.load("bowing")
person = mc.mechanism(spec, base="foot")
recording = mc.simulate(spec, BOWING, samples=2000)
estimate = mc.identify(person, recording, offsets=False, holdout=0.2)
error = estimate.psi - estimate.base.regroup(person.known)
half = 1.96 * estimate.std_setup
print(f"{(np.abs(error) < half).sum()} of {len(error)} intervals contain the truth")

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle("A person who bows: errors and their 95 % intervals")
position = np.arange(len(error))
panel.axhline(0, color="black", lw=1, label="true")
panel.errorbar(position, error, half, fmt="none", ecolor="0.6", capsize=3, label="with uncertain set-up")
panel.errorbar(position, error, 1.96 * estimate.std, fmt="o", color="C0", lw=3, ms=4, label="noise")
panel.set_xticks(position, estimate.base.names, rotation=60)
panel.set_yscale("symlog", linthresh=0.1)
panel.set_ylabel("error (kg, kg m, kg m²)")
figure.legend(loc="outside lower center", ncols=3)
