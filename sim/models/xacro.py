"""URDF files from xacro files, by the package `xacrodoc` of an extra."""

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
