# # A sensor that is late
#
# The likelihood of each delay of a force plate's clock, from a recording whose wrenches came 8 ms late.

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc
from sim.motion.excitation import DOUBLE_PENDULUM

LATE = 0.008
pendulum = mc.mechanism(mc.scenes.load("double_pendulum"), base="base")
rng, time = np.random.default_rng(0), np.arange(0, 9, 0.01)
equations = mc.Equations.of_wrench(pendulum)
late = mc.base_wrench_regressor(pendulum.tree, *DOUBLE_PENDULUM.trajectory(time - LATE), gravity=pendulum.gravity)
wrench = late @ pendulum.known + rng.normal(size=(len(time), 6)) * [1.2, 1.2, 1.2, 0.12, 0.12, 0.12]
angles = DOUBLE_PENDULUM.trajectory(time)[0] + 2.5e-4 * rng.normal(size=(len(time), 2))
channels = {f"{joint}_position": q for joint, q in zip(pendulum.tree.joints, angles.T, strict=True)}
recording = mc.Recording(time, channels | {"ground_force": wrench[:, :3], "ground_torque": wrench[:, 3:]})
(delay,) = mc.identify(pendulum, recording, offsets=False).setup
print(delay.text)

delays = np.linspace(0.0074, 0.0086, 121)
motions = (mc.Motion(*DOUBLE_PENDULUM.trajectory(time - each)) for each in delays)
fits = [mc.least_squares(equations, mc.Samples(motion, wrench)) for motion in motions]
logarithm = -len(time) * np.array([np.log(fit.residual_norms).sum() for fit in fits])

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle("Likelihood of a delay")
estimated = np.exp(-(((delays - delay.value) / delay.std) ** 2) / 2)
panel.plot(1e3 * delays, np.exp(logarithm - logarithm.max()), color="0.5", label="angles known exactly")
panel.plot(1e3 * delays, estimated, color="C0", label="estimate, angles with noise")
within = np.abs(delays - delay.value) < 1.96 * delay.std
panel.fill_between(1e3 * delays, estimated, where=within, color="C0", alpha=0.2, label="its 95 % interval")
panel.axvline(1e3 * LATE, color="black", ls="--", lw=1, label="true")
panel.set(xlabel="delay of the wrench (ms)", ylabel="likelihood over its maximum", ylim=(0, 1.05))
figure.legend(loc="outside lower center", ncols=2)
