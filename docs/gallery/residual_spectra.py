# # Spectra of residuals
#
# The right model leaves the white noise of the sensors; a wrong one leaves a moment at the frequencies of the motion.

import matplotlib.pyplot as plt
from scipy.signal import welch

import multicontact as mc
from sim.motion.excitation import DOUBLE_PENDULUM

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
