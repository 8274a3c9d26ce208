"""Inertias of bodies in MuJoCo's form: principal moments about the centre of mass, and the principal axes."""

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from ident.display.brief import INTERVALS
from ident.errors import InputError
from ident.geometry.inertia import com_from_parameters, parameters_from_com, pseudo_inertia
from ident.mechanism.drives import Drive
from ident.tolerances import ROUNDING
from sim.models.notes import body_name, note, refusals
from sim.models.xml_files import set_comment

OVERRIDING = ("settotalmass", "boundmass", "boundinertia", "balanceinertia")
"""Compiler settings, besides inertiafromgeom, that change a file's inertias."""

LIGHTEST = 1e-12
"""Least mass in kg, and least moment in kg m², that MuJoCo's compiler accepts for a moving body."""

DIGITS, SHORT = 6, 1e-4
"""Significant digits, of the largest entry, of numbers that come with an interval: no interval is narrower; and largest
error of a body's parameters that may follow, relative to the largest: central inertias may be small beside others."""


@dataclass(frozen=True, eq=False)
class Update:
    """Values of a written model that differ from those of the model that it is made from.

    Attributes:
        phi: φ of the bodies, with welds not merged (10 b,).
        drives: Drives of joints by name; others stay as they are.
        displaced: Displacements of joints in their parents' frames, m (3,), by the names of the bodies that they carry.
        comments: Comments on bodies by name, whose numbers are then short.
    """

    phi: np.ndarray
    drives: Mapping[str, Drive]
    displaced: Mapping[str, np.ndarray]
    comments: Mapping[str, str]

    @property
    def tolerance(self) -> float:
        """Difference with which φ may read back, relative to a body's largest parameter."""
        return SHORT if self.comments else 1e-9

    def changed(self, names: Sequence[str], before: Callable[[str], np.ndarray]) -> dict[str, np.ndarray]:
        """φ (10,) of the bodies, by name, that differ from those before by more than rounding.

        Raises:
            InputError: φ does not fit the bodies, or is not physical.
        """
        bodies = by_body(names, self.phi).items()
        changed = {
            name: own for name, own in bodies if abs(own - (old := before(name))).max() > ROUNDING * abs(old).max()
        }
        for name, own in changed.items():
            check_physical(name, own)
        return changed

    def comment(self, changed: Iterable[str], element_of: Callable[[str], ET.Element | None]) -> None:
        """Puts the comments into the elements of their bodies, and removes earlier ones where a body has changed."""
        for name in {*changed, *self.comments}:
            if (element := element_of(name)) is not None:
                set_comment(element, INTERVALS, self.comments.get(name, ""))


def by_body(names: Sequence[str], phi: np.ndarray) -> dict[str, np.ndarray]:
    """φ (10,) of bodies by name.

    Raises:
        InputError: The numbers are not finite, or not ten for each.
    """
    if phi.shape != (10 * len(names),) or not np.isfinite(phi).all():
        raise InputError(
            f"The bodies {', '.join(names)} need {10 * len(names)} finite parameters, got shape {phi.shape}."
        )
    return dict(zip(names, phi.reshape(-1, 10), strict=True))


def check_physical(name: str, phi: np.ndarray) -> None:
    """Refuses φ (10,) that no rigid body has; zeros are allowed, for frames."""
    if phi.any() and not is_physical(phi):
        raise InputError(f"The parameters of '{name}' are not those of a physical body.")


class Inertial(NamedTuple):
    """Inertia of one body in MuJoCo's form.

    Attributes:
        mass: Mass in kg.
        pos: Centre of mass in the body's frame, m (3,).
        quat: Quaternion `w, x, y, z` of the principal axes (4,).
        moments: Principal moments about the centre of mass, kg m² (3,).
    """

    mass: float
    pos: np.ndarray
    quat: np.ndarray
    moments: np.ndarray


def inertial_of(mass: float, com: np.ndarray, inertia: np.ndarray) -> Inertial:
    """Inertia in MuJoCo's form, from that about the centre of mass in body axes (3, 3)."""
    moments, axes = np.linalg.eigh(inertia)
    second = moments.sum() / 2 - moments
    if second.min() > -1e-9 * abs(second).max():
        # MuJoCo requires A + B >= C, which rounding may violate.
        moments = np.maximum(second, 0).sum() - np.maximum(second, 0)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    quat = np.empty(4)
    mujoco.mju_mat2Quat(quat, axes.ravel())
    return Inertial(float(mass), com, quat, moments)


def shortened(mass: float, center: np.ndarray, inertia: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass, and inertia about it with `DIGITS`, or as they are where no body could have these."""
    parts = [np.array(x, float) for x in (mass, center, inertia)]
    decimals = [DIGITS - 1 - int(np.floor(np.log10(abs(x).max() or 1))) for x in parts]
    m, c, inertia_c = (x.round(k) + 0.0 for x, k in zip(parts, decimals, strict=True))
    physical = is_physical(parameters_from_com(float(m), c, inertia_c))
    return (float(m), c, inertia_c) if physical else (mass, center, inertia)


def stated_parts(phi: np.ndarray, *, short: bool = False) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass, and inertia about it of φ (10,), zeros for a body without mass; perhaps `shortened`."""
    if not phi[0]:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    parts = com_from_parameters(phi)
    return shortened(*parts) if short else parts


def bodies_in_order(root: mujoco.MjsBody) -> Iterator[mujoco.MjsBody]:
    """A body and all its descendants in the order of the compiled model, which `MjSpec.bodies` of MuJoCo 3.3 is not."""
    yield root
    for child in root.bodies:
        yield from bodies_in_order(child)


def set_inertials(spec: mujoco.MjSpec, inertials: dict[int, Inertial]) -> None:
    """Sets the inertias of bodies, by their ids, explicitly."""
    bodies = list(bodies_in_order(spec.worldbody))
    for b, inertial in inertials.items():
        body = bodies[b]
        body.explicitinertial = True
        body.mass, body.ipos, body.iquat, body.inertia = inertial
        body.fullinertia = [np.nan, 0, 0, 0, 0, 0]
        body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT


def overrides(spec: mujoco.MjSpec) -> bool:
    """True if compiler settings change a model's inertias."""
    compiler = spec.compiler
    from_geoms = compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    return bool(from_geoms or any(getattr(compiler, key) > 0 for key in OVERRIDING))


def remove_overrides(root: ET.Element) -> None:
    """Removes compiler settings that change inertias from an MJCF document."""
    for compiler in root.findall("compiler"):
        for key in OVERRIDING:
            compiler.attrib.pop(key, None)
        if compiler.get("inertiafromgeom") == "true":
            compiler.set("inertiafromgeom", "auto")


def compiled_as_stated(spec: mujoco.MjSpec, source: object = "The model") -> mujoco.MjModel:
    """Compiles a specification with its inertias unchanged, even those that the compiler refuses.

    Args:
        spec: The specification.
        source: Name of the model in error messages.

    Raises:
        ModelError: MuJoCo refuses the specification for other reasons.
    """
    refused = {} if overrides(spec) else dict(_refused(spec))
    if not refused:
        with refusals(source):
            return spec.compile()
    spheres = spec.copy()
    for b, stated in refused.items():
        moment = max(*stated.moments, LIGHTEST)
        set_inertials(spheres, {b: stated._replace(mass=max(stated.mass, LIGHTEST), moments=np.full(3, moment))})
    with refusals(source):
        model = spheres.compile()
    for b, stated in refused.items():
        model.body_mass[b], model.body_inertia[b] = stated.mass, stated.moments
    return model


def _refused(spec: mujoco.MjSpec) -> Iterator[tuple[int, Inertial]]:
    """Ids and inertias of bodies that MuJoCo's compiler refuses; in URDF, links without `<inertial>` are massless."""
    nothing_else = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    for b, body in enumerate(bodies_in_order(spec.worldbody)):
        stated = Inertial(body.mass, body.ipos.copy(), body.iquat.copy(), body.inertia.copy())
        if not body.explicitinertial and nothing_else:
            stated = Inertial(0.0, np.zeros(3), np.array([1.0, 0, 0, 0]), np.zeros(3))
        elif not body.explicitinertial or np.isfinite(body.fullinertia[0]):
            continue
        small = stated.mass < LIGHTEST or min(stated.moments) < LIGHTEST
        if stated.mass >= 0 and (not is_balanced(stated.moments) or (small and body.joints)):
            yield b, stated


def is_balanced(moments: np.ndarray) -> bool:
    """True if a rigid body may have these principal moments, A + B ≥ C."""
    a, b, c = moments
    return bool(a + b >= c and a + c >= b and b + c >= a)


def is_physical(phi: np.ndarray) -> bool:
    """True if a rigid body with mass may have these parameters (10,), to rounding."""
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(phi))
    return bool(phi[0] > 0 and eigenvalues[0] >= -1e-12 * eigenvalues[-1])


def note_inertias(model: mujoco.MjModel) -> None:
    """Notes bodies with an impossible inertia, and moving ones without mass.

    Warns:
        ModelNote: There are such bodies.
    """
    odd = [body_name(model, b) for b in range(1, model.nbody) if not is_balanced(model.body_inertia[b])]
    if odd:
        note(f"The inertia stated for {', '.join(odd)} is taken as it is, but no rigid body has it (A + B < C).")
    together = np.bincount(model.body_weldid, model.body_mass)
    empty = [body_name(model, b) for b in range(1, model.nbody) if model.body_jntnum[b] and not together[b]]
    if empty:
        note(f"No mass is stated for {', '.join(empty)}, which joints move; it is taken as zero.")
