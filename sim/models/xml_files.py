"""Model files as XML, with comments kept and xacro expanded."""

import xml.etree.ElementTree as ET
from pathlib import Path

from ident.errors import InputError, ModelError

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
        raise InputError(
            f"{path}: xacro files need the package 'xacrodoc', which the extra 'xacro' brings: "
            f"pip install multicontact[xacro]; {by_hand}."
        ) from None
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
        raise ModelError(f"{path}: no XML that can be read: {error}.") from None
    return _root(urdf_of(path)) if is_xacro(path, root) else root


def _root(data: bytes) -> ET.Element:
    return ET.fromstring(data, ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
