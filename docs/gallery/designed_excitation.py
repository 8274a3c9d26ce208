# # A designed motion against random ones
#
# Standard deviations of each base parameter with a motion made for them, and with twenty random ones within its limits.

import matplotlib.pyplot as plt
import numpy as np

from experiments.studies import criteria, designed_excitation

problem = designed_excitation.problem_of("double_pendulum")
search = designed_excitation.DesignSearch(harmonics=4, starts=1, iterations=60)
design = designed_excitation.designed(problem, "double_pendulum", search)


def deviations(states):
    """Standard deviations of the base parameters by least squares on a motion (r,)."""
    rows = (problem.whitening @ problem.regressor(*states)).reshape(-1, len(problem.names))
    return np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))


rest, seconds = np.zeros(len(problem.joints)), float(design.time[-1])
motions = criteria.start_motions(design.limits, rest, seconds, 4, 20, seed=1)
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
