"""Couplings of a MuJoCo mechanism besides the joints of its tree: equality constraints, tendons and flexes."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.polynomial import Polynomial

from ident.errors import ModelError
from ident.geometry.se3 import pose, rotation
from ident.mechanism.body import BASE
from ident.mechanism.loops import Coincidence, Relation, Row
from ident.mechanism.tree import Tree
from sim.models.notes import body_name, joint_name, name_of, note

_JOINT, _SITE = int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtWrap.mjWRAP_SITE)
_GEOMS = (int(mujoco.mjtWrap.mjWRAP_SPHERE), int(mujoco.mjtWrap.mjWRAP_CYLINDER))

Term = tuple[int, float]
"""A joint, by its id, and its coefficient in a sum."""


class Coupling(NamedTuple):
    """One equality constraint, tendon or flex.

    Attributes:
        name: Its name, generated if the model gives none.
        kind: Its kind, for messages.
        bodies: Ids of the bodies that it acts on, for a joint those on both sides.
        joints: Names of the joints that it acts on, None if it may act on all joints between its bodies.
        row: The constraint of positions that it is, for a mechanism's `constraints`; None for others.
        soft: True if it yields so slowly that it may be meant as a spring.
    """

    name: str
    kind: str
    bodies: set[int]
    joints: set[str] | None
    row: Row | None = None
    soft: bool = False

    def __str__(self) -> str:
        return f"{self.kind} '{self.name}'" + (f" of {', '.join(sorted(self.joints))}" if self.joints else "")


def couplings(model: mujoco.MjModel) -> list[Coupling]:
    """All tendons, flexes and active equality constraints of a model."""
    tendons = [_tendon(model, t) for t in range(model.ntendon)]
    flexes = [_flex(model, f) for f in range(model.nflex)]
    # A time constant, s, or minus a stiffness per mass. Rigid parts are modelled with MuJoCo's default, 0.02 s.
    first = model.eq_solref[:, 0]
    slow = np.where(first > 0, first, (np.abs(first) + 1e-9) ** -0.5) > 2 * 0.02
    active = np.flatnonzero(model.eq_active0).tolist()
    equalities = [_equality(model, e, tendons, flexes)._replace(soft=bool(slow[e])) for e in active]
    # A tendon without forces of its own is but a sum of coordinates, for an equality or an actuator.
    return [each for t, each in enumerate(tendons) if not each.joints or _has_forces(model, t)] + flexes + equalities


def _has_forces(model: mujoco.MjModel, t: int) -> bool:
    """True if springs, dampers, friction, limits or actuators of a tendon exert forces."""
    moved = model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_TENDON)
    own = (model.tendon_stiffness, model.tendon_damping, model.tendon_frictionloss, model.tendon_limited)
    return any(np.any(x[t]) for x in own) or t in model.actuator_trnid[moved, 0]


def check_couplings(
    model: mujoco.MjModel, base: str | None, members: Sequence[int], ignore: Collection[str], fixed: Collection[str]
) -> None:
    """Refuses couplings of a mechanism with its surroundings, whose wrenches are missing in its equations.

    A coupling between bodies of the mechanism acts on both with opposite forces: it changes joint torques, see
    `check_torques`, but neither the wrench at the base nor those of contacts.

    Args:
        model: Compiled model.
        base: Name of the base body, None for the world.
        members: Ids of the mechanism's bodies.
        ignore: Names of couplings to leave out.
        fixed: Names of joints that do not move, which need no forces.

    Warns:
        ModelNote: Bodies of the mechanism are coupled with each other.

    Raises:
        ModelError: A coupling reaches outside and is not ignored, or a name is unknown.
    """
    acting = [c for c in _acting(model, members, ignore) if c.joints is None or not c.joints <= set(fixed)]
    inside = {*members, BASE} if base is None else set(members)
    _refuse([c for c in acting if not c.bodies <= inside], "which reach outside the mechanism")
    if soft := [c for c in acting if c.row and c.soft]:
        note(
            f"Soft as a spring, but taken as rigid: {', '.join(c.name for c in soft)}. With --ignore, all their joints "
            "need columns; their forces then change joint torques, but no wrench."
        )
    if others := [c for c in acting if not c.row]:
        note(
            f"The equations leave out {', '.join(map(str, others))}; between bodies of the mechanism "
            "this changes joint torques, but no wrench."
        )


def check_torques(
    model: mujoco.MjModel, members: Sequence[int], ignore: Collection[str], joints: Collection[str]
) -> None:
    """Refuses couplings other than constraints of positions that act on joints whose torques are fitted.

    Args:
        model: Compiled model.
        members: Ids of the mechanism's bodies.
        ignore: Names of couplings to leave out.
        joints: Names of the joints.

    Raises:
        ModelError: There is a coupling that is not ignored, or a name is unknown.
    """
    acting = _acting(model, members, ignore) if joints else []
    acting = [c for c in acting if not c.row and (c.joints is None or c.joints & set(joints))]
    _refuse(acting, "which act on its joints")


def loops_of(model: mujoco.MjModel, tree: Tree, held: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Joints of a tree whose torques each coupling that is not held changes, by its name: those between its bodies."""
    loops = dict[str, tuple[str, ...]]()
    for each in (each for each in couplings(model) if each.name not in held):
        names = {body_name(model, b) if b >= 0 else "" for b in each.bodies}
        joints = each.joints or {
            tree.bodies[i].joint
            for i in tree.moving
            if 0 < len(names & {tree.names[k] for k in tree.carried(i)}) < len(names)
        }
        # A joint that is fixed or follows another one is no longer coupled.
        if joints and joints <= set(tree.joints):
            loops[each.name] = tuple(joint for joint in tree.joints if joint in joints)
    return loops


def _acting(model: mujoco.MjModel, members: Sequence[int], ignore: Collection[str]) -> list[Coupling]:
    every = couplings(model)
    unknown = set(ignore) - {coupling.name for coupling in every}
    if unknown:
        raise ModelError(
            f"The model has no active equality constraint, tendon or flex named {', '.join(sorted(unknown))}; "
            f"it has {', '.join(coupling.name for coupling in every) or 'none'}."
        )
    return [c for c in every if c.bodies & set(members) and c.name not in ignore]


def _refuse(acting: Sequence[Coupling], why: str) -> None:
    if acting:
        names = [c.name for c in acting]
        raise ModelError(
            f"The equations of a tree do not hold the forces of {', '.join(map(str, acting))}, {why}. Leave them out "
            f"with --ignore {' '.join(names)} (in Python, ignore={names})."
        )


def _of_joints(model: mujoco.MjModel, name: str, kind: str, joints: Sequence[int], row: Row | None = None) -> Coupling:
    """A coupling of joints, which acts on the bodies on both sides of each; `BASE` is the world's ground."""
    bodies = {int(model.jnt_bodyid[j]) for j in joints}
    sides = bodies | {int(model.body_parentid[b]) or BASE for b in bodies}
    return Coupling(name, kind, sides, {joint_name(model, j) for j in joints}, row)


def _tendon(model: mujoco.MjModel, t: int) -> Coupling:
    name = name_of(model, mujoco.mjtObj.mjOBJ_TENDON, t)
    if terms := _terms(model, t):
        return _of_joints(model, name, "tendon", [j for j, _ in terms])
    part = slice(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t])
    owners = {_SITE: model.site_bodyid, **dict.fromkeys(_GEOMS, model.geom_bodyid)}
    wrapped = zip(model.wrap_type[part].tolist(), model.wrap_objid[part].tolist(), strict=True)
    return Coupling(name, "tendon", {int(owners[kind][k]) for kind, k in wrapped if kind in owners}, None)


def _terms(model: mujoco.MjModel, t: int) -> list[Term]:
    """Joints of a fixed tendon with their coefficients; none of a spatial one."""
    wraps = range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t])
    return [(int(model.wrap_objid[w]), float(model.wrap_prm[w])) for w in wraps if model.wrap_type[w] == _JOINT]


def _flex(model: mujoco.MjModel, f: int) -> Coupling:
    vertices = slice(model.flex_vertadr[f], model.flex_vertadr[f] + model.flex_vertnum[f])
    nodes = slice(model.flex_nodeadr[f], model.flex_nodeadr[f] + model.flex_nodenum[f])
    # The vertices of a flex with nodes are not attached to bodies.
    bodies = {*model.flex_vertbodyid[vertices].tolist(), *model.flex_nodebodyid[nodes].tolist()} - {-1}
    return Coupling(name_of(model, mujoco.mjtObj.mjOBJ_FLEX, f), "flex", bodies, None)


def _equality(model: mujoco.MjModel, e: int, tendons: Sequence[Coupling], flexes: Sequence[Coupling]) -> Coupling:
    name = name_of(model, mujoco.mjtObj.mjOBJ_EQUALITY, e)
    kind = mujoco.mjtEq(model.eq_type[e]).name.removeprefix("mjEQ_").lower()
    what = f"equality ({kind})"
    objects = [int(k) for k in (model.eq_obj1id[e], model.eq_obj2id[e]) if k >= 0]
    if kind in ("connect", "weld"):
        bodies, ends = _coincidence(model, e, name, objects)
        return Coupling(name, what, set(bodies), None, ends)
    if kind in ("joint", "tendon"):
        sums = [[(k, 1.0)] if kind == "joint" else _terms(model, k) for k in objects]
        if all(sums):
            joints = [j for terms in sums for j, _ in terms]
            return _of_joints(model, name, what, joints, _relation(model, e, name, sums))
    parts = [(tendons if kind == "tendon" else flexes)[k] for k in objects]
    return Coupling(name, what, set().union(*(c.bodies for c in parts)), None)


def _coincidence(model: mujoco.MjModel, e: int, name: str, ids: Sequence[int]) -> tuple[list[int], Coincidence]:
    """Ids of the bodies of a `connect` or `weld`, between bodies or sites, and the constraint."""
    whole, data = bool(model.eq_type[e] == mujoco.mjtEq.mjEQ_WELD), model.eq_data[e]
    if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
        bodies, ends = model.site_bodyid[ids].tolist(), [(model.site_quat[k], model.site_pos[k]) for k in ids]
    else:
        one = np.eye(4)[0]
        bodies, ends = ids, [(data[6:10], data[3:6]), (one, data[:3])] if whole else [(one, data[:3]), (one, data[3:6])]
    places = tuple(tuple(pose(rotation(turn), at).ravel().tolist()) for turn, at in ends)
    return bodies, Coincidence(name, tuple(body_name(model, b) for b in bodies), places, whole)


def _relation(model: mujoco.MjModel, e: int, name: str, sums: Sequence[Sequence[Term]]) -> Relation:
    """A sum of joints as the polynomial of another one; its displacements are from the reference configuration."""
    at = [sum(c * model.qpos0[model.jnt_qposadr[j]] for j, c in terms) for terms in sums]
    first, second = [tuple((_carried(model, j), c) for j, c in terms) for terms in (*sums, ())[:2]]
    law = Polynomial(model.eq_data[e, :5])(Polynomial([-sum(at[1:]), 1.0])) + at[0]
    return Relation(name, first, second, tuple(law.trim().coef.tolist()))


def _carried(model: mujoco.MjModel, j: int) -> str:
    """Name of the body or massless link of the tree that a joint carries."""
    b = int(model.jnt_bodyid[j])
    last = j == model.body_jntadr[b] + model.body_jntnum[b] - 1
    return body_name(model, b) if last else f"{body_name(model, b)}:{joint_name(model, j)}"
