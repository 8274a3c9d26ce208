"""Estimation of the lengths of a model's segments from markers, one factor for each body or group of bodies.

At given angles every position is linear in the factors, so that its derivatives by them are differences of positions.
Angles and factors are estimated together: the angles of each frame are eliminated from the normal equations (Schur
complement), as in bundle adjustment. Factors have a prior, 1 ± `SPREAD`; lengths that no marker determines stay those
of the model. MuJoCo's files are written with these lengths.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import mujoco
import numpy as np
from scipy import linalg

from ident.errors import InputError, ModelError
from ident.files.atomic import replacing
from ident.tolerances import ROUNDING
from sim.markers.marked_model import MarkedModel
from sim.markers.trial_fit import (
    LEAST,
    Kinematics,
    Postures,
    check_fit,
    fit_trial,
    normal_equations,
    plain_fits,
)
from sim.models.inertials import remove_overrides
from sim.models.model_update import set_asset_folders
from sim.models.notes import body_id, body_name, refusals
from sim.models.xml_files import digits

SPREAD = 0.2
"""Prior standard deviation of a factor: the variation of people's proportions about a model's."""

LARGEST = 3.0
"""Largest plausible factor, up or down."""


@dataclass(frozen=True, eq=False)
class Scaling:
    """Estimated factors of lengths.

    Attributes:
        groups: Names of the bodies that share each factor.
        factors: Factors (g,).
        std: Standard deviations, at most `SPREAD`, that of the prior (g,).
        model: The model with these lengths.
        mass: Factor on all masses.
    """

    groups: tuple[tuple[str, ...], ...]
    factors: np.ndarray
    std: np.ndarray
    model: mujoco.MjModel
    mass: float


def grouped(
    model: mujoco.MjModel, given: Sequence[Sequence[str]] = (), *, alike: bool = False
) -> list[tuple[str, ...]]:
    """Names of the bodies that share each factor.

    Args:
        model: The model.
        given: Groups that are stated; all other bodies have factors of their own.
        alike: True to give both sides the same lengths: bodies whose names differ by left and right, or by l and r,
            share a factor.

    Raises:
        ModelError: The model has no body of a name.
        InputError: A body is in two groups.
    """
    flat = list(chain(*given))
    for name in flat:
        body_id(model, name)
        if flat.count(name) > 1:
            raise InputError(f"Body '{name}' is in two groups of scale.groups; it can have one factor only.")
    names = [name for b in range(1, model.nbody) if (name := body_name(model, b)) not in flat]
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(_side_removed(name) if alike else name, []).append(name)
    return [*map(tuple, given), *map(tuple, groups.values())]


def _side_removed(name: str) -> str:
    """A body's name with the word for its side replaced."""
    words = name.lower().replace("-", "_").split("_")
    return "_".join("?" if word in ("left", "right", "l", "r") else word for word in words)


def scaled_model(
    model: mujoco.MjModel, groups: Sequence[Sequence[str]], factors: np.ndarray, mass: float = 1.0
) -> mujoco.MjModel:
    """The model with other lengths: all positions in a body's frame are multiplied by its factor.

    These are the positions of joints, sites, geoms, child bodies and the centre of mass. Inertias are scaled with the
    mass and the squared length, sizes of geoms with the length; meshes are not scaled.

    Args:
        model: The model; it is copied.
        groups: Names of the bodies that share each factor.
        factors: Factors (g,).
        mass: Factor on all masses.
    """
    own = np.ones(model.nbody)
    for group, factor in zip(groups, factors, strict=True):
        own[[body_id(model, name) for name in group]] = factor
    out = copy(model)
    out.body_pos *= own[model.body_parentid, None]
    for array, bodies in (
        (out.body_ipos, np.arange(model.nbody)),
        (out.jnt_pos, model.jnt_bodyid),
        (out.site_pos, model.site_bodyid),
    ):
        array *= own[bodies, None]
    shaped = np.where(model.geom_type == mujoco.mjtGeom.mjGEOM_MESH, 1.0, own[model.geom_bodyid])
    out.geom_pos *= shaped[:, None]
    out.geom_size *= shaped[:, None]
    out.body_mass *= mass
    out.body_subtreemass *= mass
    out.body_inertia *= mass * own[:, None] ** 2
    return out


def scaling(marked: MarkedModel, measured: np.ndarray, groups: Sequence[Sequence[str]], mass: float = 1.0) -> Scaling:
    """Estimates factors of lengths from the markers of a trial.

    Args:
        marked: The unscaled model and its markers.
        measured: Positions in the model's world, NaN where a marker is missing, m (N, M, 3).
        groups: Names of the bodies that share each factor.
        mass: Factor on all masses.

    Raises:
        InputError: A factor is above `LARGEST`, up or down, or the fit is poor with any lengths, as with wrong
            labels, units or model.
    """
    model, factors = marked.model, np.ones(len(groups))
    # At most 40 frames, evenly over the trial.
    x = measured[np.unique(np.linspace(0, len(measured) - 1, 40).round().astype(int))]
    qpos = np.array([posture.qpos for posture in plain_fits(marked, x)])
    for _ in range(30):
        now = fit_trial(marked.with_lengths(scaled_model(model, groups, factors)), x, qpos)
        qpos = now.qpos
        curvature, gradient = _reduced(now, groups, factors)
        # Never quite zero, so that the prior determines factors that the markers do not.
        sigma = max(float(np.nan_to_num(now.sigma)), 1e-6)
        prior = (sigma / SPREAD) ** 2
        step = np.linalg.solve(curvature + prior * np.eye(len(groups)), gradient + prior * (1 - factors))
        factors = factors + step
        if not ((factors > 1 / LARGEST) & (factors < LARGEST)).all():
            names = ", ".join(groups[int(np.abs(np.log(np.abs(factors))).argmax())])
            raise InputError(
                f"The lengths of {names} would have to be scaled by a factor above {LARGEST:g}, up or down: check "
                "unit, labels and places of the markers (the residuals of a run without --scale tell which)."
            )
        if np.abs(step).max() < 1e-6:
            break
    check_fit(now)
    std = sigma * np.sqrt(np.diag(np.linalg.inv(curvature + prior * np.eye(len(groups)))))
    return Scaling(tuple(map(tuple, groups)), factors, std, scaled_model(model, groups, factors, mass), mass)


def _reduced(postures: Postures, groups: Sequence[Sequence[str]], factors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Curvature (g, g) and gradient (g,) for the factors, with the angles eliminated."""
    marked, model = postures.marked, postures.marked.model
    kinematics, n, g = Kinematics(marked), len(marked.dofs), len(groups)
    longer = [
        Kinematics(marked.with_lengths(scaled_model(model, [group], np.array([1 + 1 / factor]))))
        for group, factor in zip(groups, factors, strict=True)
    ]
    curvature, gradient = np.zeros((g, g)), np.zeros(g)
    for qpos, residual, robust in zip(postures.qpos, postures.residuals, postures.robust, strict=True):
        used = robust > 0
        p = kinematics.positions(qpos)
        L = np.stack([(other.positions(qpos) - p)[used] for other in longer], axis=2)
        J = np.concatenate([kinematics.jacobian()[used], L], axis=2)
        normal, right = normal_equations(J, (robust * marked.weights)[used, None], residual[used])
        normal[:n, :n] += LEAST * np.eye(n)
        solved = linalg.solve(normal[:n, :n], np.column_stack([normal[:n, n:], right[:n]]), assume_a="pos")
        curvature += normal[n:, n:] - normal[n:, :n] @ solved[:, :-1]
        gradient += right[n:] - normal[n:, :n] @ solved[:, -1]
    return curvature, gradient


def write_scaled(path: Path, spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Writes a specification with the positions and inertias of a model of the same bodies, with all digits.

    Args:
        path: MJCF file to write; its folder must exist. Meshes and textures are those of the specification.
        spec: The specification, compiled before.
        model: The model with other lengths.

    Raises:
        ModelError: MuJoCo does not read the file back as the model.
    """
    with refusals("The model"):
        root = ET.fromstring(spec.to_xml())
    remove_overrides(root)
    bodies = [body for world in root.findall("worldbody") for body in (world, *world.iter("body"))]
    for b, body in enumerate(bodies):
        _place(model, b, body)
    set_asset_folders(root, spec, Path(spec.modelfiledir), path.parent)
    with replacing(path) as temporary:
        temporary.write_text(ET.tostring(root, encoding="unicode") + "\n", encoding="utf-8")
        with refusals(path):
            written = mujoco.MjModel.from_xml_path(str(temporary))
        _check(path, written, model)


def _place(model: mujoco.MjModel, b: int, body: ET.Element) -> None:
    """Sets the numbers of a body and of its joints, sites, geoms and inertia."""
    if b:
        _set(body, pos=model.body_pos[b], quat=model.body_quat[b])
    joints = [each for each in body if each.tag in ("joint", "freejoint")]
    for j, joint in zip(np.flatnonzero(model.jnt_bodyid == b), joints, strict=True):
        if joint.tag == "joint" and model.jnt_type[j] != mujoco.mjtJoint.mjJNT_FREE:
            _set(joint, pos=model.jnt_pos[j], axis=model.jnt_axis[j])
    for s, site in zip(np.flatnonzero(model.site_bodyid == b), body.findall("site"), strict=True):
        _set(site, pos=model.site_pos[s], quat=model.site_quat[s])
    for g, geom in zip(np.flatnonzero(model.geom_bodyid == b), body.findall("geom"), strict=True):
        if model.geom_type[g] != mujoco.mjtGeom.mjGEOM_MESH:
            _set(geom, pos=model.geom_pos[g], size=model.geom_size[g])
    for old in body.findall("inertial"):
        body.remove(old)
    if b and model.body_mass[b]:
        inertial = ET.Element("inertial", mass=repr(float(model.body_mass[b])))
        _set(inertial, pos=model.body_ipos[b], quat=model.body_iquat[b], diaginertia=model.body_inertia[b])
        body.insert(0, inertial)


def _set(element: ET.Element, **numbers: Iterable[float]) -> None:
    """Sets attributes with all digits."""
    for key, values in numbers.items():
        element.set(key, digits(values))


def _check(path: Path, written: mujoco.MjModel, model: mujoco.MjModel) -> None:
    """Refuses a file whose model differs from the given one."""
    for name in ("body_pos", "body_quat", "jnt_pos", "jnt_axis", "site_pos", "body_mass", "body_ipos", "body_inertia"):
        a, b = getattr(written, name), getattr(model, name)
        rows = slice(1, None) if name.startswith("body") else slice(None)
        if a.shape != b.shape or (np.abs(a - b)[rows] > ROUNDING * max(1.0, float(np.abs(b).max(initial=0.0)))).any():
            raise ModelError(f"{path}: MuJoCo does not read the scaled model back as it was written ({name}).")
