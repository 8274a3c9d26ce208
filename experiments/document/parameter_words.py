"""Parameters in words: `m2rz2` is the first moment of the shank along z about the knee."""

from collections.abc import Iterator

import numpy as np

from experiments.document.symbols import PARAMETER
from ident.geometry.inertia import body_index
from ident.mechanism.body import Body
from ident.mechanism.mechanism import Mechanism
from ident.parameters.base_parameters import BaseParameters

SHOWN = 0.0005
"""Smallest coefficient of a regrouping that is put into words."""


def order(name: str) -> int:
    """Order of a parameter as a moment of mass: 0, 1 or 2.

    >>> [order(name) for name in ("m1", "m2rz2", "Ixx3")]
    [0, 1, 2]
    """
    match = PARAMETER.fullmatch(name)
    assert match is not None
    return 2 if match[3] else 1 if match[2] else 0


def in_words(name: str, arm: Mechanism) -> str:
    """A parameter, or another coefficient, in words."""
    match = PARAMETER.fullmatch(name)
    if match is None:
        return name.replace("offset(", "constant offset of ").rstrip(")") if name.startswith("offset(") else name
    body = arm.tree.bodies[arm.tree.inertial[body_index(name) or 0]]
    if match[3]:
        axes = match[3]
        about = f"moment of inertia of {body.name} about {axes[0]}"
        kind = about if axes[0] == axes[1] else f"product of inertia {axes} of {body.name}"
        return f"{kind}, at {_origin(body)}"
    if match[2]:
        return f"first moment of {body.name} along {match[2]} about {_origin(body)}"
    return f"mass of {body.name}"


def regrouped_in_words(base: BaseParameters, k: int, arm: Mechanism) -> str:
    """The k-th base parameter and its regrouped terms, in words."""
    parts = list(_parts(base, k, arm))
    named = in_words(base.names[k], arm)
    return f"{named}, which also includes: {'; '.join(parts)}" if parts else named


def _parts(base: BaseParameters, k: int, arm: Mechanism) -> Iterator[str]:
    """The other parameters in a base parameter, each with its factor, whose unit is a power of metres."""
    own = order(base.names[k])
    for coefficient, d in zip(base.beta[k], base.dependent, strict=True):
        if abs(coefficient) > SHOWN:
            power = own - order(base.parameters[d])
            metres = {0: "", 1: " m", 2: " m²", -1: " 1/m", -2: " 1/m²"}[power]
            factor = "" if not metres and abs(coefficient - 1) < SHOWN else f"{coefficient:.3g}{metres} × "
            yield f"{factor}the {in_words(base.parameters[d], arm)}"


def _origin(body: Body) -> str:
    """The origin of a body's frame in words: its joint if the joint's axis passes through it."""
    on_axis = body.moves and not np.any(body.twist[:3]) and bool(body.joint)
    return f"joint {body.joint}" if on_axis else f"the origin of the frame of {body.name}"
