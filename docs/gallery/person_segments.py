# # A person's segments
#
# Base parameters of a person who bows on a force plate, from angles with noise of half a degree, with 95 % intervals.

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc
from sim.motion.excitation import BOWING

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
