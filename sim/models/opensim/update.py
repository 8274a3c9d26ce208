"""OpenSim files with other inertias: masses, centres and inertias replaced in the file's own bytes, all else kept."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from ident.errors import InputError, ModelError
from ident.geometry.inertia import com_from_parameters
from ident.mechanism.mechanism import Mechanism
from ident.recordings.atomic import replacing
from sim.models.inertials import is_physical
from sim.models.opensim.document import model_element
from sim.models.opensim.frames import Frames
from sim.models.opensim.mechanism import MOMENTS, OpenSimOrigin, body_parameters

BODIES = ["OpenSimDocument", "Model", "BodySet", "objects", "Body"]
"""The elements that a body stands in, itself included."""

_TAG = re.compile(rb"""<[^\s/>]+(?:\s+[^\s=]+\s*=\s*(?:"[^"]*"|'[^']*'))*\s*(/?)>""")


@dataclass
class _Element:
    """Where an element stands in a file: bytes of its start, of what follows its start tag, and of its end tag."""

    start: int
    inside: int
    end: int
    closed: bool


@dataclass
class _BodyText:
    """Where a body and what it states stand in a file."""

    element: _Element
    stated: dict[str, _Element] = field(default_factory=dict)


def write_opensim(path: Path, mechanism: Mechanism, phi: np.ndarray) -> None:
    """Writes the file of a mechanism with other inertial parameters.

    Args:
        path: File to write; its folder must exist.
        mechanism: The mechanism, from an OpenSim file.
        phi: φ of its bodies, welds kept (10 b,).

    Raises:
        ModelError: The file is in an encoding of two bytes a letter, has elements in entities, or does not read back.
        InputError: φ does not fit the bodies, one is not physical, or the file would not end in `.osim`.
    """
    origin: OpenSimOrigin = mechanism.source
    if path.suffix.lower() != ".osim":
        raise InputError(f"From an OpenSim file an OpenSim file is made; write '{path.stem}.osim' instead.")
    before = Frames(model_element(origin.path)).bodies
    names = mechanism.bodies
    if phi.shape != (10 * len(names),) or not np.isfinite(phi).all() or not set(names) <= set(before):
        raise InputError(
            f"The bodies {', '.join(names)} need {10 * len(names)} finite parameters, welds kept, got {phi.shape}."
        )
    new = dict(zip(names, phi.reshape(-1, 10), strict=True))
    changed = {
        name: own
        for name, own in new.items()
        if not np.allclose(own, body_parameters(before[name]), rtol=1e-12, atol=0)
    }
    for name, own in changed.items():
        if own.any() and not is_physical(own):
            raise InputError(f"The parameters of '{name}' are not those of a physical body.")
    with replacing(path) as temporary:
        temporary.write_bytes(_replaced(origin.path, changed))
        after = Frames(model_element(temporary)).bodies
        for name, own in new.items():
            if abs(body_parameters(after[name]) - own).max() > 1e-9 * abs(own).max():
                raise ModelError(f"{path}: the parameters of '{name}' do not read back as they were written.")


def _replaced(path: Path, bodies: Mapping[str, np.ndarray]) -> bytes:
    """The bytes of a file with other φ (10,) of some bodies."""
    data = path.read_bytes()
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data[:4]:
        raise ModelError(f"{path}: a file in UTF-16 or UTF-32 cannot be written back; save it in UTF-8.")
    places = _places(data)
    edits = [edit for name, phi in bodies.items() for edit in _edits(places[name], phi)]
    for first, last, words in sorted(edits, reverse=True):
        data = data[:first] + words + data[last:]
    return data


def _edits(body: _BodyText, phi: np.ndarray) -> Iterator[tuple[int, int, bytes]]:
    """What of a file's bytes, first and last, becomes what for a body's φ."""
    mass, center, inertia = com_from_parameters(phi) if phi[0] else (0.0, np.zeros(3), np.zeros((3, 3)))
    entries = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    numbers: dict[str, Sequence[float]] = {"mass": [mass], "mass_center": center.tolist()}
    if "inertia" in body.stated or not any(tag.startswith("inertia_") for tag in body.stated):
        numbers["inertia"] = entries.tolist()
    else:
        numbers |= {f"inertia_{key}": [x] for key, x in zip(MOMENTS, entries.tolist(), strict=True)}
    for tag, values in numbers.items():
        words = " ".join(repr(float(x)) for x in values).encode()
        whole = b"<" + tag.encode() + b">" + words + b"</" + tag.encode() + b">"
        place = body.stated.get(tag)
        if place is None:
            yield body.element.inside, body.element.inside, whole
        elif place.closed:
            yield place.start, place.inside, whole
        else:
            yield place.inside, place.end, words


def _places(data: bytes) -> dict[str, _BodyText]:
    """Where the bodies of a file stand, and their children, by the bodies' names."""
    parser, path, open_elements = expat.ParserCreate(), list[str](), list[_Element]()
    bodies: dict[str, _BodyText] = {}
    current: list[_BodyText] = []

    def start(tag: str, attributes: dict[str, str]) -> None:
        at = parser.CurrentByteIndex
        match = _TAG.match(data, at)
        if match is None:
            raise ModelError("A file whose elements come from entities cannot be written back; let OpenSim save it.")
        element = _Element(at, match.end(), at, bool(match[1]))
        path.append(tag)
        open_elements.append(element)
        if path == BODIES:
            current[:] = [bodies.setdefault(attributes.get("name", "").strip(), _BodyText(element))]
        elif path[:-1] == BODIES:
            current[0].stated.setdefault(tag, element)

    def end(_: str) -> None:
        path.pop()
        open_elements.pop().end = parser.CurrentByteIndex

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(data, True)
    return bodies
