# # Axes that are not where the model has them
#
# Errors of base parameters if the axes are tilted and the model's are not: one degree costs more than the noise.

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc
from sim.motion.excitation import DOUBLE_PENDULUM

drawn = mc.mechanism(mc.scenes.load("double_pendulum"), base="base")
base = mc.find_base_parameters(drawn)
angles, errors = (0, 1, 2, 3, 4, 5), {"axes along X": [], "axes as they are": []}
for angle in angles:
    spec = mc.scenes.load("double_pendulum", tilt_deg=angle, azimuth_deg=120)
    recording = mc.simulate(spec, DOUBLE_PENDULUM, samples=500)
    for name, model in zip(errors, (drawn, mc.mechanism(spec, base="base")), strict=True):
        equations = mc.Equations(model, mc.find_base_parameters(model, kept=base.names))
        fit = mc.least_squares(equations, recording)
        errors[name].append(np.abs(fit.psi - fit.parameters.regroup(drawn.known)))
print(f"at 5°, axes along X: largest error {errors['axes along X'][-1].max():.1f}")

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle("Errors of 13 base parameters over the tilt of the axes")
for (name, of_name), color in zip(errors.items(), ("C1", "C0"), strict=True):
    panel.semilogy(angles, of_name, color=color, lw=0.6, alpha=0.7)
    panel.semilogy(angles, np.max(of_name, axis=1), "o-", color=color, lw=2, label=f"largest, model with {name}")
panel.set(xlabel="tilt (°)", ylabel="error (kg, kg m, kg m²)", ylim=(1e-3, 5))
panel.legend(loc="lower right", framealpha=1)
