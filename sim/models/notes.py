"""Names of a model's elements, generated where it gives none, remarks on it, and MuJoCo's errors as one line."""

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import mujoco
import numpy as np

from ident.display.brief import listed
from ident.errors import ModelError
from ident.geometry.inertia import com_from_parameters
from ident.mechanism.loops import Constraints
from ident.mechanism.mechanism import Mechanism

_STEMS = {
    mujoco.mjtObj.mjOBJ_BODY: "body",
    mujoco.mjtObj.mjOBJ_JOINT: "joint",
    mujoco.mjtObj.mjOBJ_SITE: "site",
    mujoco.mjtObj.mjOBJ_FLEX: "flex",
    mujoco.mjtObj.mjOBJ_TENDON: "tendon",
    mujoco.mjtObj.mjOBJ_EQUALITY: "equality",
    mujoco.mjtObj.mjOBJ_SENSOR: "sensor",
    mujoco.mjtObj.mjOBJ_ACTUATOR: "actuator",
}

LONGEST = 20.0
"""Distance of a body from its parent, or of its centre of mass from its origin, m, above which it is in millimetres:
links of 20 mm and more are then noted, links of real machines are shorter than 20 m."""

LIGHTEST, HEAVIEST, SLENDER = 0.03, 1e5, 0.2
"""Densities, kg/m³, below and above which a unit is wrong, and least thickness over length of the ellipsoid for that.
Materials have 100 to 20000, real models with light or roughly stated links 1 to 60000; wrong units make a factor of
1000 or, to the power of 3/2, of a million and more. Inertias of thin rods are often stated without their thickness."""


def name_of(model: mujoco.MjModel, kind: mujoco.mjtObj, index: int) -> str:
    """Unique name of an element: the model's, or its kind with its id, and `_` appended if that is taken.

    Args:
        model: Compiled model.
        kind: Its kind: body, joint, site, flex, tendon, equality constraint, sensor or actuator.
        index: Its id.
    """
    name = mujoco.mj_id2name(model, kind, index)
    if name:
        return name
    name = f"{_STEMS[kind]}{index}"
    while mujoco.mj_name2id(model, kind, name) >= 0:
        name += "_"
    return name


def body_name(model: mujoco.MjModel, b: int) -> str:
    """Name of a body."""
    return name_of(model, mujoco.mjtObj.mjOBJ_BODY, b)


def joint_name(model: mujoco.MjModel, j: int) -> str:
    """Name of a joint."""
    return name_of(model, mujoco.mjtObj.mjOBJ_JOINT, j)


def id_of(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> int:
    """Id of the body, the world excepted, or of the joint with a name.

    Raises:
        ModelError: There is none.
    """
    is_body = kind == mujoco.mjtObj.mjOBJ_BODY
    names = [name_of(model, kind, index) for index in range(is_body, model.nbody if is_body else model.njnt)]
    if name not in names:
        there = f"its {'bodies' if is_body else 'joints'} are {', '.join(names) or 'none'}"
        raise ModelError(f"The model has no {_STEMS[kind]} named '{name}'; {there}.")
    return names.index(name) + is_body


def body_id(model: mujoco.MjModel, name: str) -> int:
    """Id of the body with a name, the world excepted; errors as for `id_of`."""
    return id_of(model, mujoco.mjtObj.mjOBJ_BODY, name)


class ModelNote(UserWarning):
    """A remark on a model; commands print it as a line of its own, once."""


def note(text: str) -> None:
    """Warns the user about a model, at the line that calls these packages."""
    level, frame = 1, sys._getframe()
    while frame.f_back and frame.f_globals.get("__name__", "").split(".")[0] in ("sim", "ident"):
        level, frame = level + 1, frame.f_back
    warnings.warn(text, ModelNote, stacklevel=level)


@contextmanager
def without_log() -> Iterator[None]:
    """Drops MuJoCo's warnings in a block, which it would append to a file MUJOCO_LOG.TXT in the working folder."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


@contextmanager
def refusals(source: object) -> Iterator[None]:
    """Turns MuJoCo's errors in a block into one line that begins with their source; the block should only call MuJoCo.

    Args:
        source: The model's file, or a name for a model without one.

    Raises:
        ModelError: MuJoCo cannot read or compile the model, or lacks memory.
    """
    try:
        with without_log():
            yield
    except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        text = " ".join(str(error).split())
        raise ModelError(text if text.startswith(str(source)) else f"{source}: {text}") from None


UNITS = {"kg cm², or in g mm² with masses in g": 1e-4, "kg mm²": 1e-6, "g cm²": 1e-7, "g mm²": 1e-9}
"""Units in which inertias are given by mistake, kg m²."""


def constrained(arm: Mechanism, constraints: Constraints) -> Mechanism:
    """The mechanism with constraints, and with those axes of its loops parallel that nearly are.

    Warns:
        ModelNote: There are such axes, or less nearly parallel ones, which stay; or constraints.

    Raises:
        ModelError: Constraints contradict each other, or their numbers are beyond all use.
    """
    tree, moved, drawn = constraints.aligned(arm.tree)
    if moved:
        note(
            f"Axes in loops that are nearly parallel count as parallel ({', '.join(moved)} off): loops move only then."
        )
    if drawn:
        note(
            f"Axes in loops that are not quite parallel are taken as drawn ({', '.join(drawn)} off): such loops hardly "
            "move, or have other base parameters. Where parallel ones are meant, give them the same axis."
        )
    if names := [row.name for row in constraints.rows]:
        joints = ", ".join(constraints.coupled(tree))
        note(f"By the constraints {', '.join(names)} of {joints}, joints without a column follow from the others.")
    return replace(arm, tree=tree, constraints=constraints.checked(tree))


def note_units(arm: Mechanism) -> None:
    """Notes a mechanism's lengths and bodies that are plausible in other units only.

    Warns:
        ModelNote: There are such.
    """
    bodies, phi = arm.tree.bodies, np.zeros((0, 10)) if arm.prior is None else arm.prior.reshape(-1, 10)
    lengths = {f"'{body.name}' from its parent": np.linalg.norm(body.home[:3, 3].astype(float)) for body in bodies}
    heavy, light = dict[str, float](), dict[str, tuple[float, str]]()
    for name, own in zip(arm.bodies, phi, strict=False):
        # A body of a millionth of the heaviest's mass only stands for a place.
        if not np.isfinite(own).all() or own[0] <= 1e-6 * phi[:, 0].max():
            continue
        mass, com, inertia = com_from_parameters(own)
        lengths[f"the centre of mass of '{name}' from its origin"] = np.linalg.norm(com)
        second = np.trace(inertia) / 2 - np.linalg.eigvalsh(inertia)
        if second.min() <= 0:
            continue
        semi_axes = np.sqrt(5 * second / mass)
        volumes = (
            4 / 3 * np.pi * each.prod() for each in (semi_axes, np.maximum(semi_axes, SLENDER * semi_axes.max()))
        )
        density, least = (mass / volume for volume in volumes)
        if density < LIGHTEST:
            # The likeliest unit leads to the density of a usual body.
            unit = min(UNITS, key=lambda key: abs(np.log(density / UNITS[key] ** 1.5 / 1500)))
            light[name] = density, unit
        elif least > HEAVIEST:
            heavy[name] = least
    farthest = max(lengths, key=lambda key: lengths[key], default="")
    if farthest and lengths[farthest] > LONGEST:
        where = f"{farthest} at {lengths[farthest]:.3g} m"
        note(f"The model has {where}: its lengths may be in mm; kg, m and kg m² are needed.")
    for unit in dict.fromkeys(unit for _, unit in light.values()):
        these = {name: density for name, (density, its) in light.items() if its == unit}
        note(f"By mass and inertia {_densities(these)}: their inertias may be in {unit}; kg, m and kg m² are needed.")
    if heavy:
        note(f"By mass and inertia {_densities(heavy)}: their masses may be in g; kg, m and kg m² are needed.")


def _densities(bodies: dict[str, float]) -> str:
    """Bodies with their densities."""
    each = listed(f"{name} ({density:.2g})" for name, density in bodies.items())
    return f"the densities of these bodies, in kg/m³, are those of no material: {each}"
