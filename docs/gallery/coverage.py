# # Do intervals cover the truth?
#
# The 95 % intervals of one parameter from a hundred simulated recordings; those that miss the truth are marked.

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc
from sim.motion.excitation import DOUBLE_PENDULUM

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
