# # Base parameters of an arm with seven joints
#
# Which standard parameters (columns) make up which base parameters (rows); it follows from the geometry alone.

from math import pi

import matplotlib.pyplot as plt
import numpy as np

import multicontact as mc

alpha = (0, -pi / 2, pi / 2, pi / 2, -pi / 2, pi / 2, pi / 2)
d = (0, 0, 0, 0.0825, -0.0825, 0, 0.088)
r = (0.333, 0, 0.316, 0, 0.384, 0, 0)
rows = enumerate(zip(alpha, d, r, strict=True), start=1)
frames = [
    mc.Frame(f"link{k}", f"link{k - 1}" if k > 1 else None, "revolute", alpha=a, d=x, r=z) for k, (a, x, z) in rows
]
base = mc.find_base_parameters(mc.Mechanism(mc.tree_from_mdh(frames), np.array([0, 0, -9.81])))
matrix = np.zeros((base.rank, len(base.parameters)))
matrix[np.arange(base.rank), list(base.kept)] = 1
matrix[:, list(base.dependent)] = base.beta
print(f"{base.rank} of {len(base.parameters)}; {base.expressions(3)[3]}")

figure, panel = plt.subplots(figsize=(6, 4), layout="constrained")
figure.suptitle(f"{base.rank} base parameters of {len(base.parameters)} standard parameters")
image = panel.imshow(np.where(matrix == 0, np.nan, matrix), cmap="coolwarm", vmin=-1, vmax=1, aspect="auto")
for body in range(1, len(frames)):
    panel.axvline(10 * body - 0.5, color="0.7", lw=0.5)
panel.set_xticks(10 * np.arange(len(frames)) + 4.5, [f"link {k}" for k in range(1, len(frames) + 1)])
panel.set(ylabel="base parameter", xlabel="standard parameter")
panel.tick_params(axis="x", length=0)
figure.colorbar(image, label="coefficient", extend="both")
