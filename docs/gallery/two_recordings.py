# # Do two recordings agree?
#
# Differences of two estimates in standard deviations: chance with the right model, far beyond it with a wrong one.

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc
from sim.motion.excitation import DOUBLE_PENDULUM

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
