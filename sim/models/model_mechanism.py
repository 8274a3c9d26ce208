"""Mechanisms from models: tree, gravity, masses, sites, joint ranges, drives, and constraints that close loops."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.polynomial import Polynomial

from ident.annotations import typed
from ident.arguments import checked_coordinates
from ident.errors import ModelError
from ident.geometry.se3 import inverse
from ident.mechanism.body import BASE
from ident.mechanism.constraint import Coincidence, Constraint, Relation
from ident.mechanism.loops import Constraints
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.tolerances import HUGE
from sim.models.couplings import loops_of
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
    placed_pose,
    rest_coordinates,
    tree_from_model,
)
from sim.models.notes import joint_name, name_of, note, note_units
from sim.models.opensim.reading import is_opensim, mechanism_from_opensim
from sim.models.urdf import transmissions

_CONNECT, _WELD = int(mujoco.mjtEq.mjEQ_CONNECT), int(mujoco.mjtEq.mjEQ_WELD)
_JOINT, _TENDON = int(mujoco.mjtEq.mjEQ_JOINT), int(mujoco.mjtEq.mjEQ_TENDON)
_SITE = int(mujoco.mjtObj.mjOBJ_SITE)

Terms = tuple[tuple[str, float], ...]


def constraints_of(
    model: mujoco.MjModel, tree: Tree, ignore: Collection[str], posture: Mapping[str, np.ndarray]
) -> Constraints:
    """Constraints among the bodies of a tree, of which none is ignored.

    Args:
        model: Compiled model.
        tree: The tree.
        ignore: Names of equality constraints to leave out.
        posture: Coordinates of all joints of the model's tree, those of its fixed ones included.
    """
    rows = list[Constraint]()
    for e in range(model.neq):
        name = name_of(model, mujoco.mjtObj.mjOBJ_EQUALITY, e)
        if model.eq_active0[e] and name not in ignore and (row := _constraint(model, tree, e, name)) is not None:
            rows.append(row)
    held = {body.name: posture[body.still] for body in tree.bodies if body.still}
    return Constraints(tuple(rows), posture).fixed(held, tree)


def _constraint(model: mujoco.MjModel, tree: Tree, e: int, name: str) -> Constraint | None:
    """One equality as a constraint; None where it reaches outside the tree, or is none of positions."""
    kind = int(model.eq_type[e])
    if kind not in (_CONNECT, _WELD, _JOINT, _TENDON):
        return None
    if not (abs(model.eq_data[e]) < HUGE).all():
        raise ModelError(f"The constraint '{name}' needs numbers below {HUGE:g}, as of its anchor or polycoef.")
    if kind in (_CONNECT, _WELD):
        between = _coincidence(model, e, name)
        return between if {*between.bodies} <= {*tree.names} else None
    sums = _of_joint if kind == _JOINT else _of_tendon
    sides = [sums(model, int(k)) if k >= 0 else ((), 0.0) for k in (model.eq_obj1id[e], model.eq_obj2id[e])]
    if sides[0] is None or sides[1] is None:
        return None
    (first, at), (second, of_second) = sides[0], sides[1]
    # The polynomial is one of displacements from the reference configuration.
    law = Polynomial(model.eq_data[e, :5])(Polynomial([-of_second, 1.0])) + at
    row = Relation(name, first, second, tuple(law.trim().coef.tolist()))
    return row if set(row.bodies) <= set(tree.names) else None


def _coincidence(model: mujoco.MjModel, e: int, name: str) -> Coincidence:
    """A `connect` or `weld`, between bodies or sites."""
    whole, data, ids = model.eq_type[e] == _WELD, model.eq_data[e], (model.eq_obj1id[e], model.eq_obj2id[e])
    if model.eq_objtype[e] == _SITE:
        bodies = [int(model.site_bodyid[k]) for k in ids]
        places = [placed_pose(model.site_pos[k], model.site_quat[k]) for k in ids]
    else:
        bodies, one = [int(k) for k in ids], np.eye(4)[0]
        points = (data[3:6], data[:3]) if whole else (data[:3], data[3:6])
        places = [placed_pose(points[0], data[6:10] if whole else one), placed_pose(points[1], one)]
    names = [name_of(model, mujoco.mjtObj.mjOBJ_BODY, b) for b in bodies]
    own = [tuple(place.ravel().tolist()) for place in places]
    return Coincidence(name, (names[0], names[1]), (own[0], own[1]), bool(whole))


def _of_joint(model: mujoco.MjModel, j: int) -> tuple[Terms, float] | None:
    """A joint's coordinate as a sum by the names of the bodies in the tree, and its value in the reference."""
    return ((_carried(model, j), 1.0),), float(model.qpos0[model.jnt_qposadr[j]])


def _of_tendon(model: mujoco.MjModel, t: int) -> tuple[Terms, float] | None:
    """Length of a fixed tendon, likewise; None for a spatial one."""
    wraps = range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t])
    if any(model.wrap_type[w] != mujoco.mjtWrap.mjWRAP_JOINT for w in wraps):
        return None
    terms = [(int(model.wrap_objid[w]), float(model.wrap_prm[w])) for w in wraps]
    return tuple((_carried(model, j), c) for j, c in terms), float(model.tendon_length0[t])


def _carried(model: mujoco.MjModel, j: int) -> str:
    """Name of the body or massless link of the tree that a joint carries."""
    b = int(model.jnt_bodyid[j])
    body = name_of(model, mujoco.mjtObj.mjOBJ_BODY, b)
    last = j == model.body_jntadr[b] + model.body_jntnum[b] - 1
    return body if last else f"{body}:{joint_name(model, j)}"


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
    constraints = constraints_of(model, tree, ignore, posture).checked(tree)
    held = {row.name for row in constraints.rows}
    loops = {name: joints for name, joints in loops_of(model, tree).items() if name not in held}
    # Drives of its own act on a joint that depends on others, not on one that follows another.
    mimics = {joint: lead for joint, lead in constraints.followers(tree).items() if joint not in driven}
    arm = replace(arm, mimics=mimics, loops=loops, constraints=constraints).rested()
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
