"""Markers of C3D files, read by ezc3d (Michaud & Begon, JOSS 6(58):2911, 2021, doi:10.21105/joss.02911)."""

from pathlib import Path

import numpy as np

from ident.errors import LogError


def c3d_markers(path: Path) -> tuple[np.ndarray, tuple[str, ...], np.ndarray, str]:
    """Times (N,), labels, positions (N, M, 3) in the unit that the file states, and that.

    Markers with a negative residual were not seen.

    Raises:
        LogError: The extra 'c3d' is not installed, or the file is malformed or has no markers.
    """
    try:
        import ezc3d
    except ModuleNotFoundError:
        raise LogError("a .c3d file needs the extra 'c3d': pip install multicontact[c3d].") from None
    try:
        file = ezc3d.c3d(str(path))
        point, points = file["parameters"]["POINT"], file["data"]["points"]
        labels, unit = tuple(point["LABELS"]["value"]), point["UNITS"]["value"][0].strip()
        rate, first = float(point["RATE"]["value"][0]), int(file["header"]["points"]["first_frame"])
        residuals = np.asarray(file["data"]["meta_points"]["residuals"])[0]
    # ezc3d raises what C++ raised, and its dictionaries lack what the file lacks.
    except (OSError, RuntimeError, ValueError, KeyError, IndexError) as error:
        raise LogError(f"ezc3d cannot read the markers of this file ({error}).") from None
    if unit not in ("m", "cm", "mm") or not rate > 0:
        raise LogError(f"POINT:UNITS is m, cm or mm and POINT:RATE positive, got '{unit}' and {rate:g} Hz.")
    positions = np.where(residuals < 0, np.nan, points[:3]).transpose(2, 1, 0)[:, : len(labels)]
    return (first + np.arange(len(positions))) / rate, labels, positions, unit
