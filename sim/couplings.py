"""What acts on a MuJoCo mechanism besides the joints of its tree: equality constraints, tendons and flexes."""

from collections.abc import Sequence
from typing import NamedTuple

import mujoco

_JOINT, _SITE = int(mujoco.mjtWrap.mjWRAP_JOINT), int(mujoco.mjtWrap.mjWRAP_SITE)
_GEOMS = (int(mujoco.mjtWrap.mjWRAP_SPHERE), int(mujoco.mjtWrap.mjWRAP_CYLINDER))


class Coupling(NamedTuple):
    """One equality constraint, tendon or flex.

    Attributes:
        name: Its name, or `equality`, `tendon` or `flex` with its index.
        kind: What it is, for a message.
        bodies: Ids of the bodies that it acts on.
    """

    name: str
    kind: str
    bodies: set[int]


def couplings(model: mujoco.MjModel) -> list[Coupling]:
    """All tendons, flexes and active equality constraints of a model."""
    tendons = [_tendon(model, t) for t in range(model.ntendon)]
    flexes = [_flex(model, f) for f in range(model.nflex)]
    equalities = [_equality(model, e, tendons, flexes) for e in range(model.neq) if model.eq_active0[e]]
    return tendons + flexes + equalities


def check_couplings(model: mujoco.MjModel, members: Sequence[int], ignore: Sequence[str]) -> None:
    """Refuses couplings of a mechanism that its equations do not hold.

    Args:
        model: Compiled model.
        members: Ids of the mechanism's bodies.
        ignore: Names of couplings to leave out.

    Raises:
        ValueError: A coupling on the mechanism is not ignored, or a name is unknown.
    """
    every = couplings(model)
    unknown = set(ignore) - {coupling.name for coupling in every}
    if unknown:
        raise ValueError(
            f"The model has no active equality constraint, tendon or flex named {', '.join(sorted(unknown))}; "
            f"it has {', '.join(coupling.name for coupling in every) or 'none'}."
        )
    left = [f"{c.kind} '{c.name}'" for c in every if c.bodies & set(members) and c.name not in ignore]
    if left:
        raise ValueError(
            f"The equations of a tree do not hold the forces of {', '.join(left)}. Name them in `ignore` to leave them "
            "out: joint torques will lack their forces, and base wrenches where they reach outside the mechanism."
        )


def _tendon(model: mujoco.MjModel, t: int) -> Coupling:
    bodies = set()
    for w in range(model.tendon_adr[t], model.tendon_adr[t] + model.tendon_num[t]):
        if model.wrap_type[w] == _JOINT:
            bodies.add(int(model.jnt_bodyid[model.wrap_objid[w]]))
        elif model.wrap_type[w] == _SITE:
            bodies.add(int(model.site_bodyid[model.wrap_objid[w]]))
        elif model.wrap_type[w] in _GEOMS:
            bodies.add(int(model.geom_bodyid[model.wrap_objid[w]]))
    return Coupling(model.tendon(t).name or f"tendon{t}", "tendon", bodies)


def _flex(model: mujoco.MjModel, f: int) -> Coupling:
    part = slice(model.flex_vertadr[f], model.flex_vertadr[f] + model.flex_vertnum[f])
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_FLEX, f) or f"flex{f}"
    return Coupling(name, "flex", set(model.flex_vertbodyid[part].tolist()))


def _equality(model: mujoco.MjModel, e: int, tendons: Sequence[Coupling], flexes: Sequence[Coupling]) -> Coupling:
    kind = mujoco.mjtEq(model.eq_type[e]).name.removeprefix("mjEQ_").lower()
    objects = [int(k) for k in (model.eq_obj1id[e], model.eq_obj2id[e]) if k >= 0]
    if kind == "tendon":
        bodies = set().union(*(tendons[k].bodies for k in objects))
    elif kind.startswith("flex"):
        bodies = set().union(*(flexes[k].bodies for k in objects))
    elif kind == "joint":
        bodies = {int(model.jnt_bodyid[k]) for k in objects}
    elif model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
        bodies = {int(model.site_bodyid[k]) for k in objects}
    else:
        bodies = set(objects)
    return Coupling(model.eq(e).name or f"equality{e}", f"equality ({kind})", bodies)
