"""Errors of tools' inertias over size: `python -m docs.tools.tool_errors FOLDER DRAWS` prints rows of docs/payload.md.

    e_ij = |I_ij - true I_ij| / (m/12 |δ_ij a·a - a_i a_j|)      I about the sensor, in its axes; mean of six

as in AnalyzeExperiments of the published method (arXiv:2302.06685), whose a are the sides of the mesh's bounding box.
Without meshes a are those of a uniform box of the tool's mass and central moments.
"""

import argparse
from collections import defaultdict
from pathlib import Path
from shutil import copytree
from tempfile import TemporaryDirectory

import numpy as np

from experiments.cli.options import whole_number
from experiments.studies.validation.files import registry
from experiments.studies.validation.validation_study import of_bodies
from ident.geometry.inertia import parameters_from_com, symmetric

DETERMINED = "hammer", "clamp", "pliers"
"""Tools whose whole inertia the motion determines at all levels."""

HELD = {"held, mass": slice(1), "held, centre": slice(1, 4), "held, inertia": slice(4, 10), "held": slice(10)}
"""Quantities whose intervals are counted."""


def about_sensor(body: np.ndarray) -> np.ndarray:
    """Inertia about the sensor (3, 3) of mass, centre and inertia about the centre (10,)."""
    return symmetric(parameters_from_com(body[0], body[1:4], symmetric(body[4:]))[4:])


def over_size(estimate: np.ndarray, true: np.ndarray) -> float:
    """Mean error of the six moments and products about the sensor, over those of a box (10,)."""
    sides = np.sqrt(np.maximum(6 / true[0] * (true[4:7].sum() - 2 * true[4:7]), 0))
    box = true[0] / 12 * np.abs(np.eye(3) * (sides @ sides) - np.outer(sides, sides))
    return float((np.abs(about_sensor(estimate) - about_sensor(true)) / box)[np.triu_indices(3)].mean())


def rows(folder: Path, draws: int) -> dict[str, list[float]]:
    """Per cent by level: errors of inertias of each tool, of those determined and of all, of masses; held intervals."""
    entry, errors = registry()["tools"], defaultdict[tuple[str, str], list[float]](list)
    for draw in range(draws):
        with TemporaryDirectory() as scratch:
            # The folder's name draws the noise; the first is that of `validate`.
            own = copytree(folder, Path(scratch) / (folder.name if not draw else f"{folder.name} {draw}"))
            for level, made in of_bodies(entry, own, Path(scratch)).items():
                values, low, high, true = (
                    np.reshape(made[key], (-1, 10)) for key in ("values", "lower", "upper", "true")
                )
                holds = (low <= true) & (true <= high)
                for name, part in HELD.items():
                    errors[name, level].append(holds[:, part].mean())
                for name, x, known in zip(made["names"][::10], values, true, strict=True):
                    errors[name.split()[0], level].append(over_size(x, known))
                    errors["mass", level].append(abs(x[0] / known[0] - 1))
    levels = list(entry.options["noise"])
    mean = {name: [100 * float(np.mean(errors[name, level])) for level in levels] for name, _ in errors}
    others = {name: mean.pop(name) for name in ("mass", *HELD)}
    three = np.mean([mean[name] for name in DETERMINED], axis=0).tolist()
    return {**mean, "these three": three, "all": np.mean(list(mean.values()), axis=0).tolist(), **others}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        "python -m docs.tools.tool_errors", description="Errors of tools' inertias over size."
    )
    parser.add_argument("folder", type=Path, help="folder of the recordings of the eight tools")
    parser.add_argument("draws", type=whole_number(1), help="draws of the noise")
    args = parser.parse_args()
    for name, each in rows(args.folder, args.draws).items():
        print(f"| {name} | {' | '.join(f'{x:.3g}' for x in each)} |")
