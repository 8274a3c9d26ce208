"""Names of the elements of a MuJoCo model, generated where the model gives none."""

import mujoco

from ident.errors import ModelError

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
    first, count, several = {
        mujoco.mjtObj.mjOBJ_BODY: (1, model.nbody, "bodies"),
        mujoco.mjtObj.mjOBJ_JOINT: (0, model.njnt, "joints"),
    }[kind]
    names = [name_of(model, kind, index) for index in range(first, count)]
    if name not in names:
        raise ModelError(
            f"The model has no {_STEMS[kind]} named '{name}'; its {several} are {', '.join(names) or 'none'}."
        )
    return first + names.index(name)


def body_id(model: mujoco.MjModel, name: str) -> int:
    """Id of the body with a name, the world excepted; errors as for `id_of`."""
    return id_of(model, mujoco.mjtObj.mjOBJ_BODY, name)
