"""Constraints of positions between bodies of a mechanism, from the equalities of a MuJoCo model."""

from collections.abc import Collection, Mapping

import mujoco
import numpy as np
from numpy.polynomial import Polynomial

from ident.mechanism.constraint import Coincidence, Constraint, Relation
from ident.mechanism.loops import Constraints
from ident.mechanism.tree import Tree
from sim.models.mujoco_model import placed_pose
from sim.models.notes import joint_name, name_of

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
    if kind in (_CONNECT, _WELD):
        between = _coincidence(model, e, name)
        return between if {*between.bodies} <= {*tree.names} else None
    if kind not in (_JOINT, _TENDON):
        return None
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
