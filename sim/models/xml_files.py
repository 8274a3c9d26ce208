"""Model files as XML, xacro expanded, and written with some elements changed and all other bytes kept."""

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from html import escape
from pathlib import Path
from typing import NamedTuple
from xml.parsers import expat

from ident.errors import InputError, ModelError, not_installed
from ident.tolerances import ROUNDING

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
    """Bytes of an MJCF, URDF or OpenSim file, those of the URDF file that a xacro file describes.

    Raises:
        ModelError: The file does not exist, is no XML, an MJCF file in another encoding than UTF-8, has a name that is
            none, or cannot be expanded.
        InputError: What expands xacro is not installed.
    """
    if not path.is_file():
        raise ModelError(f"A model is an MJCF, URDF or OpenSim file that exists, got '{path}'.")
    if str(path).encode(errors="replace").decode() != str(path):
        raise ModelError(f"The name of a model file has to be text in UTF-8, got {str(path)!r}; rename it.")
    data = path.read_bytes()
    try:
        root = _root(data)
        if root.tag == "mujoco":
            # MuJoCo does not read what the file declares.
            data.decode()
    except UnicodeDecodeError as error:
        raise ModelError(f"{path}: MJCF needs to be in UTF-8 ({error}).") from None
    except (ET.ParseError, LookupError, ValueError) as error:
        # The last two are raised for unknown, non-text or multi-byte encodings.
        raise ModelError(f"{path}: the file needs to be XML ({error}).") from None
    return urdf_of(path) if is_xacro(path, root) else data


def parsed(path: Path) -> ET.Element:
    """Root element of a model file, with comments kept; errors as for `text_of`."""
    return _root(text_of(path))


def _root(data: bytes) -> ET.Element:
    return ET.fromstring(data, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))


_TAG = re.compile(rb"""(<[^\s/>]+(?:\s+[^\s=]+\s*=\s*(?:"[^"]*"|'[^']*'))*)(\s*/?>)""")
_ATTRIBUTE = re.compile(rb"""(\s+([^\s=]+)\s*=\s*(["']))(.*?)(\3)""", re.DOTALL)
_BLANK = re.compile(rb"\s*(?=<)")
_WORD = re.compile(rb"(\S+)")


class _Place(NamedTuple):
    """Bytes of an element or a comment in a file, and what it has there.

    Attributes:
        start: First byte of it.
        head: Its start tag, without what closes it.
        close: What closes its start tag, `/>` of an element that has no end tag.
        inside: First byte after its start tag.
        end: First byte of its end tag, or after its start tag if it has none.
        tail: Its end tag.
        attributes: Its attributes.
        text: The text in it, up to its first child.
    """

    start: int
    head: bytes
    close: bytes
    inside: int
    end: int
    tail: bytes
    attributes: dict[str, str]
    text: str


class ModelFile:
    """A well-formed XML file whose elements may change, and its bytes with these changes and no others.

    Attributes:
        root: Its root element, comments kept. Attributes, comments, and texts of elements without children may change,
            attributes may be removed, and elements and comments inserted. A comment whose text is None is removed.

    Raises:
        ModelError: The file is in UTF-16 or UTF-32, or has elements in entities.
    """

    def __init__(self, path: Path, data: bytes) -> None:
        if data[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\0" in data[:4]:
            raise ModelError(f"{path}: a file in UTF-16 or UTF-32 cannot be written back; save it in UTF-8.")
        self._data, self._encoding, self._places = data, "utf-8", dict[ET.Element, _Place]()
        builder, parser = ET.TreeBuilder(insert_comments=True), expat.ParserCreate()
        open_tags = list[re.Match[bytes]]()

        def declared(_: str, encoding: str | None, __: int) -> None:
            self._encoding = encoding or self._encoding

        def start(tag: str, attributes: dict[str, str]) -> None:
            match = _TAG.match(data, parser.CurrentByteIndex)
            if match is None:
                raise ModelError(
                    f"{path}: a file whose elements come from entities cannot be written back; save it with the "
                    "elements themselves, as the program it is from does."
                )
            open_tags.append(match)
            builder.start(tag, attributes)

        def end(tag: str) -> None:
            match, element = open_tags.pop(), builder.end(tag)
            last = stop = match.end()
            if match[2][-2:] != b"/>":
                last = parser.CurrentByteIndex
                stop = data.index(b">", last) + 1
            parts = match.start(), match[1], match[2], match.end(), last, data[last:stop]
            self._places[element] = _Place(*parts, dict(element.attrib), element.text or "")

        def comment(text: str) -> None:
            first = parser.CurrentByteIndex
            # Those in entities are not in the file itself.
            if data.startswith(b"<!--", first):
                parts = first, b"<!--", b"", first + 4, data.index(b"-->", first), b"-->"
                self._places[builder.comment(text)] = _Place(*parts, {}, text)

        # Defaults of attributes in a document type are not in the file's elements.
        parser.specified_attributes = True
        parser.XmlDeclHandler, parser.CommentHandler = declared, comment
        parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = start, end, builder.data
        parser.Parse(data, True)
        self.root = builder.close()

    def changed(self) -> bytes:
        """Bytes of the file with what has changed in its elements.

        Of an attribute or a text with as many words as before, only those words change that are others. An inserted
        element is on a line of its own if its parent's first child is.
        """
        root = self._places[self.root]
        stop = root.end + len(root.tail)
        return self._data[: root.start] + self._written(self.root) + self._data[stop:]

    def _written(self, element: ET.Element) -> bytes:
        """An element or a comment with what has changed in it, or a new one."""
        if callable(element.tag):
            new = _Place(0, b"<!--", b"", 0, 0, b"-->", {}, "")
        else:
            new = _Place(0, f"<{element.tag}".encode(), b"/>", 0, 0, b"", {}, "")
        place = self._places.get(element, new)
        head, inside = self._head(element, place), self._inside(element, place)
        if inside and place.close[-2:] == b"/>":
            return head + b">" + inside + f"</{element.tag}>".encode()
        return head + place.close + inside + place.tail

    def _head(self, element: ET.Element, place: _Place) -> bytes:
        """Start tag of an element, without what closes it."""

        def attribute(match: re.Match[bytes]) -> bytes:
            key = match[2].decode(self._encoding)
            if key not in element.attrib:
                return b""
            return match[1] + self._with_words(match[4], place.attributes[key], element.attrib[key]) + match[5]

        added = {key: value for key, value in element.items() if key not in place.attributes}
        texts = [b" " + key.encode() + b'="' + self._encoded(value) + b'"' for key, value in added.items()]
        return _ATTRIBUTE.sub(attribute, place.head) + b"".join(texts)

    def _inside(self, element: ET.Element, place: _Place) -> bytes:
        """Bytes between the tags of an element, or of a comment."""
        data, at = self._data, place.inside
        if not len(element):
            return self._with_words(data[at : place.end], place.text, element.text or "")
        blank, parts = _BLANK.match(data, at, place.end), list[bytes]()
        for child in element:
            gone = callable(child.tag) and child.text is None
            if (own := self._places.get(child)) is not None:
                before = data[at : own.start]
                parts.append(before.rstrip() if gone else before)
                at = own.end + len(own.tail)
            elif blank is not None:
                parts.append(blank[0])
            parts.append(b"" if gone else self._written(child))
        return b"".join([*parts, data[at : place.end]])

    def _with_words(self, stated: bytes, old: str, new: str) -> bytes:
        """Bytes of a text with those words that are others; all of it if their number is another."""
        before, after, parts = old.split(), new.split(), _WORD.split(stated)
        if before == after:
            return stated
        if not len(before) == len(after) == len(parts) // 2:
            return self._encoded(new)
        for k, (word, other) in enumerate(zip(before, after, strict=True)):
            if word != other:
                parts[2 * k + 1] = self._encoded(other)
        return b"".join(parts)

    def _encoded(self, text: str) -> bytes:
        return escape(text, quote=False).replace('"', "&quot;").encode(self._encoding, "xmlcharrefreplace")


def set_comment(element: ET.Element, begin: str, text: str) -> None:
    """Puts a comment first into an element, or in place of one in it that has this beginning; "" removes that."""
    for remark in element:
        if callable(remark.tag) and (remark.text or "").strip().startswith(begin):
            remark.text = f" {text} " if text else None
            return
    if text:
        element.insert(0, ET.Comment(f" {text} "))


def digits(numbers: Iterable[float]) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(x)) for x in numbers)


def restated(stated: str | None, numbers: Iterable[float], size: float | None = None) -> str:
    """Numbers as text, with the words of what is stated for those that differ by rounding only.

    Args:
        stated: Numbers as they are stated, None if they are not; an empty text means zeros.
        numbers: The numbers.
        size: Number relative to which a difference is rounding, by default the largest.
    """
    values = [float(x) for x in numbers]
    near = ROUNDING * (max(map(abs, values)) if size is None else size)
    words = (stated or "").split()
    if len(words) == len(values):
        pairs = zip(words, values, strict=True)
        return " ".join(word if abs(_number(word) - x) <= near else repr(x) for word, x in pairs)
    return "" if stated is not None and not words and max(map(abs, values)) <= near else digits(values)


def _number(word: str) -> float:
    """A number of a file, NaN for what Python does not read."""
    try:
        return float(word)
    except ValueError:
        return math.nan
