"""Model files as XML, xacro expanded: their elements, and edits that replace some bytes and keep all others."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from ident.errors import InputError, ModelError, not_installed

LARGEST = 1e100
"""Upper limit of a model's numbers, so that products of them are finite."""

SUFFIX = ".xacro"
"""End of the names of xacro files, which are URDF files with macros."""


def is_xacro(path: Path, root: ET.Element) -> bool:
    """True if an XML file has xacro's elements, or is called a xacro file."""
    return path.suffix.lower() == SUFFIX or any("xacro}" in str(element.tag) for element in root.iter())


def urdf_of(path: Path) -> bytes:
    """Text of the URDF file that a xacro file describes, with the default values of its arguments.

    Raises:
        InputError: The package that expands it is not installed.
        ModelError: It cannot be expanded.
    """
    target = f"{path.name.partition('.')[0]}_expanded.urdf"
    by_hand = f"or write the URDF file yourself: xacro {path.name} [ARG:=VALUE] > {target}"
    try:
        import xacro
        from xacrodoc import packages
    except ImportError:
        raise InputError(f"{path}: {not_installed('a xacro file', 'xacrodoc', 'xacro')}; {by_hand}.") from None
    try:
        # Importing xacrodoc lets xacro find packages without ROS.
        packages.walk_up_from(path)
        expanded: str = xacro.process_file(str(path)).toxml()
    # Python of its expressions, XML and package searches have errors of all classes.
    except Exception as error:
        why = " ".join(str(error).split()) or type(error).__name__
        raise ModelError(f"{path}: no xacro file that can be expanded ({why}). Correct it, {by_hand}.") from None
    return expanded.encode()


def text_of(path: Path) -> bytes:
    """Bytes of a model file, those of the URDF file that a xacro file describes."""
    return urdf_of(path) if is_xacro(path, _root(path.read_bytes())) else path.read_bytes()


def parsed(path: Path) -> ET.Element:
    """Root element of an MJCF, URDF or OpenSim file, with comments kept, and xacro expanded.

    Raises:
        ModelError: The file does not exist, is no XML, has a name that is no UTF-8 text, or cannot be expanded.
        InputError: What expands xacro is not installed.
    """
    if not path.is_file():
        raise ModelError(f"A model is an MJCF, URDF or OpenSim file that exists, got '{path}'.")
    if str(path).encode(errors="replace").decode() != str(path):
        raise ModelError(f"The name of a model file has to be text in UTF-8, got {str(path)!r}; rename it.")
    try:
        root = _root(path.read_bytes())
    except (ET.ParseError, LookupError, ValueError) as error:
        # The last two are raised for unknown, non-text or multi-byte encodings.
        raise ModelError(f"{path}: the file needs to be XML ({error}).") from None
    return _root(urdf_of(path)) if is_xacro(path, root) else root


def _root(data: bytes) -> ET.Element:
    return ET.fromstring(data, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))


_TAG = re.compile(rb"""<[^\s/>]+(?:\s+[^\s=]+\s*=\s*(?:"[^"]*"|'[^']*'))*\s*(/?)>""")
_ATTRIBUTE = re.compile(rb"""\s([^\s=/<]+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
_BLANK = re.compile(rb"\s*(?=<)")


class Edit(NamedTuple):
    """Replacement of the bytes of a file from `first` to before `last` by a text."""

    first: int
    last: int
    text: bytes


@dataclass
class Element:
    """An element and its position in a file.

    Attributes:
        tag: Its tag.
        attributes: Its attributes.
        start: First byte of its start tag.
        inside: First byte after its start tag.
        end: First byte of its end tag, or after its start tag if it has none.
        closed: True for an empty element, `<tag/>`, which has no end tag.
        children: Its child elements.
    """

    tag: str
    attributes: dict[str, str]
    start: int
    inside: int
    end: int
    closed: bool
    children: list["Element"] = field(default_factory=list)

    def child(self, tag: str) -> "Element | None":
        """First child with a tag, None without one."""
        return next((child for child in self.children if child.tag == tag), None)

    def below(self, *tags: str) -> Iterator["Element"]:
        """Descendants at the end of a path of tags."""
        if not tags:
            yield self
            return
        for child in self.children:
            if child.tag == tags[0]:
                yield from child.below(*tags[1:])

    def attribute(self, data: bytes, name: str) -> tuple[int, int] | None:
        """First byte of an attribute's value and the first after it, None if the element does not have it."""
        for match in _ATTRIBUTE.finditer(data, self.start, self.inside):
            if match[1] == name.encode():
                return match.span(2 if match[2] is not None else 3)
        return None

    def with_attributes(self, data: bytes, text: bytes) -> Edit:
        """Edit that adds attributes, each after a blank, to the start tag."""
        end = self.inside - (2 if self.closed else 1)
        end = self.start + len(data[self.start : end].rstrip())
        return Edit(end, end, text)

    def with_first(self, data: bytes, text: bytes) -> Edit:
        """Edit that inserts text before the first child, on a line of its own if that child is on one."""
        if self.closed:
            end = self.start + len(data[self.start : self.inside - 2].rstrip())
            return Edit(end, self.inside, b">" + text + b"</" + self.tag.encode() + b">")
        blank = _BLANK.match(data, self.inside, self.end)
        return Edit(self.inside, self.inside, (blank[0] if blank else b"") + text)


def root_of(path: Path, data: bytes) -> Element:
    """Root element of a well-formed file, with the positions of all elements in it.

    Raises:
        ModelError: The file is in UTF-16 or UTF-32, or has elements in entities.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data[:4]:
        raise ModelError(f"{path}: a file in UTF-16 or UTF-32 cannot be written back; save it in UTF-8.")
    parser, open_elements = expat.ParserCreate(), [Element("", {}, 0, 0, len(data), False)]

    def start(tag: str, attributes: dict[str, str]) -> None:
        at = parser.CurrentByteIndex
        match = _TAG.match(data, at)
        if match is None:
            raise ModelError(
                f"{path}: a file whose elements come from entities cannot be written back; save it with the elements "
                "themselves, as the program it is from does."
            )
        place = Element(tag, attributes, at, match.end(), match.end(), bool(match[1]))
        open_elements[-1].children.append(place)
        open_elements.append(place)

    def end(_: str) -> None:
        place = open_elements.pop()
        if not place.closed:
            place.end = parser.CurrentByteIndex

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.Parse(data, True)
    return open_elements[0].children[0]


def edited(data: bytes, edits: Iterable[Edit]) -> bytes:
    """Bytes after edits, which must not overlap; edits at one position are applied in the given order."""
    parts, done = list[bytes](), 0
    for first, last, text in sorted(edits, key=lambda edit: edit[:2]):
        parts += [data[done:first], text]
        done = last
    return b"".join([*parts, data[done:]])


def with_sections(path: Path, data: bytes, other: bytes, tags: Collection[str]) -> bytes:
    """Bytes of a file in UTF-8 whose elements right below the root are those of another, byte for byte, for some tags.

    They stay as they are if the other is in another encoding, has elements in entities, or not the same ones.
    """
    try:
        other.decode()
        own, others = ([x for x in root_of(path, each).children if x.tag in tags] for each in (data, other))
    except (ModelError, UnicodeDecodeError):
        return data
    if [x.tag for x in own] != [x.tag for x in others]:
        return data
    return edited(
        data, [Edit(*_span(data, x), other[slice(*_span(other, y))]) for x, y in zip(own, others, strict=True)]
    )


def _span(data: bytes, place: Element) -> tuple[int, int]:
    """First byte of an element and the first after it."""
    return place.start, place.end if place.closed else data.index(b">", place.end) + 1


def with_comment(data: bytes, element: Element, text: str) -> Edit:
    """Edit that puts a comment first into an element that is not closed, in place of one that begins alike."""
    alike = re.compile(rb"\s*<!-- " + re.escape(text.partition(":")[0]).encode() + rb".*?-->", re.DOTALL)
    before, blank = (pattern.match(data, element.inside, element.end) for pattern in (alike, _BLANK))
    end = before.end() if before else element.inside
    return Edit(element.inside, end, (blank[0] if blank else b"\n") + f"<!-- {text} -->".encode())


def digits(numbers: Iterable[float]) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(x)) for x in numbers)
