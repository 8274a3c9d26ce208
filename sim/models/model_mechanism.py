"""Mechanisms from models: tree, gravity, masses, sites, joint ranges, drives, and constraints that close loops."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np

from ident.annotations import typed
from ident.arguments import checked_coordinates
from ident.errors import ModelError
from ident.geometry.se3 import inverse
from ident.mechanism.body import BASE
from ident.mechanism.loops import Constraints
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from sim.models.couplings import couplings, loops_of
from sim.models.model_drives import drives_of_model
from sim.models.mujoco_model import (
    BEYOND,
    Source,
    base_pose,
    compiled,
    gravity_in_base,
    mechanism_bodies,
    parameters_from_model,
    place_of_site,
    rest_coordinates,
    tree_from_model,
)
from sim.models.notes import constrained, joint_name, name_of, note, note_units
from sim.models.opensim.reading import is_opensim, mechanism_from_opensim
from sim.models.urdf import transmissions


@dataclass(frozen=True, eq=False)
class Origin:
    """Origin of a mechanism, its `source`.

    Attributes:
        model: The compiled model.
        text: File or specification that can be updated; None for a model that was given compiled.
        base: Name of the body whose frame is {0}, None for the world's.
        beyond: Names of bodies at which the mechanism ends.
        packages: Folders of ROS packages that were searched for a URDF file's meshes.
    """

    model: mujoco.MjModel
    text: mujoco.MjSpec | str | Path | None
    base: str | None
    beyond: tuple[str, ...]
    packages: tuple[Path, ...] = ()


@typed("source", "fix")
def mechanism(
    source: Source,
    base: str | None = None,
    beyond: Sequence[str] = BEYOND,
    *,
    merge_welds: bool = False,
    ignore: Collection[str] = (),
    fix: Mapping[str, float | Sequence[float]] | Sequence[str] | None = None,
    packages: Sequence[str | Path] = (),
    drives: bool = True,
    base_rpy_deg: Sequence[float] | None = None,
) -> Mechanism:
    """Mechanism of a body and all its descendants in a model.

    Args:
        source: The model; it is compiled once. OpenSim files, which end in `.osim`, are read without MuJoCo.
        base: Name of the body whose frame is {0}, as for `tree_from_model`; so are all other arguments.
        beyond: Names of bodies that, with all their descendants, are not part of the mechanism.
        merge_welds: True to merge welded bodies into their parents.
        ignore: Names of equality constraints and tendons to leave out of the equations.
        fix: Names of the tree's joints that do not move, with their coordinates or alone.
        packages: Folders of ROS packages, for meshes of a URDF file at `package://`; folders next to the file, above it
            and in `ROS_PACKAGE_PATH` are searched as well.
        drives: False to leave out the drives of the joints.
        base_rpy_deg: Roll, pitch and yaw of the base frame in the world, degrees, for a base at rest that is mounted in
            another way than in the model, as `(180, 0, 0)` upside down; by default as in the model.

    Returns:
        The mechanism, with `Origin` or `OpenSimOrigin` as its source. It has no prior if all bodies are massless.

    Warns:
        ModelNote: As for `tree_from_model`, `drives_of_model`, `mechanism_from_opensim` and `note_units`.

    Raises:
        ModelError: As for `tree_from_model`, a body has numbers that are not finite, or the drive of a joint has
            negative ones.
        InputError: `base_rpy_deg` is malformed.
    """
    if is_opensim(source):
        arm = mechanism_from_opensim(str(source), base, beyond, ignore=ignore, fix=fix, drives=drives)
    else:
        text = None if isinstance(source, mujoco.MjModel) else source
        origin = Origin(compiled(source, packages), text, base, tuple(beyond), tuple(map(Path, packages)))
        arm = _from_mujoco(origin, ignore, checked_coordinates("fix", () if fix is None else fix), drives=drives)
    arm = arm if base_rpy_deg is None else arm.mounted(base_rpy_deg)
    note_units(arm)
    return _with_merged_welds(arm) if merge_welds else arm


def _from_mujoco(
    origin: Origin, ignore: Collection[str], fix: Mapping[str, Sequence[float]], *, drives: bool
) -> Mechanism:
    """Mechanism of a model that MuJoCo reads."""
    model, base, beyond = origin.model, origin.base, origin.beyond
    members = mechanism_bodies(model, base, beyond)
    tree = tree_from_model(model, base, beyond, ignore=ignore, fix=fix)
    prior = parameters_from_model(model, base, beyond) if model.body_mass[members].any() else None
    geared = transmissions(origin.text) if drives and isinstance(origin.text, str | Path) else {}
    driven = drives_of_model(model, tree.freedoms, geared) if drives else {}
    gravity, pose = gravity_in_base(model, base), base_pose(model, base)
    arm = Mechanism(tree, gravity, prior, _sites(model, members), _ranges(model, tree), origin, pose, drives=driven)
    posture = rest_coordinates(model, base, beyond) | {joint: np.array(q) for joint, q in fix.items() if q}
    rows = (each.row for each in couplings(model) if each.row and each.name not in ignore)
    inside = tuple(row for row in rows if {*row.bodies} <= {*tree.names})
    held = {body.name: posture[body.still] for body in tree.bodies if body.still}
    arm = constrained(arm, Constraints(inside, posture).fixed(held, tree))
    loops = loops_of(model, arm.tree, [row.name for row in arm.constraints.rows])
    arm = replace(arm, loops=loops).rested()
    if arm.loose:
        note(
            f"Constraints and actuators leave {', '.join(arm.loose)} free, which only springs, limits or contacts "
            "hold. Log them, or state by --fix where they rest: all others in their loops follow from driven ones then."
        )
    return arm


def mujoco_origin(arm: Mechanism) -> Origin:
    """Origin of a mechanism that was read by MuJoCo.

    Raises:
        ModelError: It was not.
    """
    if not isinstance(arm.source, Origin):
        raise ModelError(f"This needs a model in MJCF or URDF, which MuJoCo reads, not '{arm.source.path}'.")
    return arm.source


def _with_merged_welds(arm: Mechanism) -> Mechanism:
    """The mechanism with welded bodies merged into their parents."""
    tree, merged = arm.tree.without_welds()
    sites = {name: _on_carrier(arm.tree, tree, *site) for name, site in arm.sites.items()}
    return replace(arm, tree=tree, prior=None if arm.prior is None else merged @ arm.prior, sites=sites)


def _sites(model: mujoco.MjModel, members: Sequence[int]) -> dict[str, tuple[str, np.ndarray]]:
    """Sites that are fixed to bodies of a mechanism, by name."""
    places = {name_of(model, mujoco.mjtObj.mjOBJ_SITE, s): place_of_site(model, s, members) for s in range(model.nsite)}
    return {name: place for name, place in places.items() if place is not None}


def _on_carrier(tree: Tree, merged: Tree, name: str, pose: np.ndarray) -> tuple[str, np.ndarray]:
    """A place on a body of a tree, as a place on the merged body of the tree without welds."""
    i = tree.names.index(name)
    while i != BASE and tree.names[i] not in merged.names:
        i, pose = tree.bodies[i].parent, tree.bodies[i].home @ pose
    if i == BASE:
        carrier = next(body for body in merged.bodies if not body.moves)
        return carrier.name, inverse(carrier.home) @ pose
    return tree.names[i], pose


def _ranges(model: mujoco.MjModel, tree: Tree) -> dict[str, tuple[float, float]]:
    """Limits of the hinges and slides of a tree that have limits, rad or m."""
    limits = {joint_name(model, j): model.jnt_range[j].tolist() for j in range(model.njnt) if model.jnt_limited[j]}
    joints = [tree.bodies[i].joint for i in tree.moving if not tree.bodies[i].is_ball]
    return {joint: (limits[joint][0], limits[joint][1]) for joint in joints if joint in limits}
