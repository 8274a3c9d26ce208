"""Published anthropometric tables: masses, centres of mass and radii of gyration of the segments of people.

winter   Winter, *Biomechanics and Motor Control of Human Movement*, 2009, Table 4.1 (doi:10.1002/9780470549148), after
         Dempster; one column for both sexes, and radii of gyration across the segment only: those along it have de
         Leva's ratio to them.
deleva   de Leva, J. Biomech. 29:1223-1230, 1996, Table 4 (doi:10.1016/0021-9290(95)00178-6).
dumas    Dumas, Chèze and Verriest, J. Biomech. 40:543-553, 2007 (doi:10.1016/j.jbiomech.2006.02.013), only along the
         segment: offsets of centres across it, of a few per cent of its length, and products of inertia are left out.

The numbers were compared with those of three public collections: BMClab/BMC (Winter, de Leva), wspr/body-segment-param
(de Leva), and the scripts of the HuMoD database (Dumas). The spread between persons is that of men measured by magnetic
resonance by Cheng et al., Clin. Biomech. 15:559-566, 2000, as given by wspr/body-segment-param.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from ident.errors import InputError

TABLES, SEXES = ("winter", "deleva", "dumas"), ("female", "male")

STATURE = {"male": 1.741, "female": 1.735}
"""Mean height of de Leva's subjects, m, to which the lengths refer."""

LANDMARKS = ("upper_trunk", "middle_trunk", "lower_trunk", "torso", "pelvis", "trunk", "head_and_trunk", "hat")
"""Segments whose ends are not, or not necessarily, adjacent joints of a model."""


@dataclass(frozen=True)
class Segment:
    """One segment of a table.

    Attributes:
        mass: Its share of the person's mass.
        center: Distance of the centre of mass from the proximal end, over the length.
        across: Radius of gyration about axes across the segment through that centre, over the length.
        along: Radius of gyration about the segment's own axis, over the length.
        ends: Landmarks at its proximal and at its distal end.
        length: Its length over the person's height, for segments that do not end at a joint; 0 if not published.
    """

    mass: float
    center: float
    across: float
    along: float
    ends: tuple[str, str]
    length: float = 0.0


_ENDS = {
    "head": ("vertebra C7", "vertex"),
    "trunk": ("middle of the hips", "middle of the shoulders"),
    "upper_trunk": ("suprasternale", "xiphion"),
    "middle_trunk": ("xiphion", "omphalion"),
    "lower_trunk": ("omphalion", "middle of the hips"),
    "torso": ("cervical joint", "lumbar joint"),
    "pelvis": ("lumbar joint", "middle of the hips"),
    "head_and_trunk": ("greater trochanters", "shoulders"),
    "hat": ("greater trochanters", "shoulders"),
    "upper_arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
    "forearm_and_hand": ("elbow", "wrist"),
    "arm": ("shoulder", "wrist"),
    "hand": ("wrist", "third knuckle"),
    "thigh": ("hip", "knee"),
    "shank": ("knee", "ankle"),
    "foot": ("ankle", "metatarsal heads"),
    "leg": ("hip", "ankle"),
    "shank_and_foot": ("knee", "ankle"),
}
"""Ends of the segments, unless a table has its own."""

# Mass, centre from the first of the ends, radii about the sagittal, transverse and longitudinal axis, mean length in m.
_DELEVA = {
    "male": {
        "head": (0.0694, 1 - 0.5002, 0.303, 0.315, 0.261, 0.2429),
        "trunk": (0.4346, 1 - 0.4310, 0.384, 0.358, 0.197, 0.5155),
        "upper_trunk": (0.1596, 0.2999, 0.716, 0.454, 0.659, 0.1707),
        "middle_trunk": (0.1633, 0.4502, 0.482, 0.383, 0.468, 0.2155),
        "lower_trunk": (0.1117, 0.6115, 0.615, 0.551, 0.587, 0.1457),
        "upper_arm": (0.0271, 0.5772, 0.285, 0.269, 0.158, 0.2817),
        "forearm": (0.0162, 0.4574, 0.276, 0.265, 0.121, 0.2689),
        "hand": (0.0061, 0.7900, 0.628, 0.513, 0.401, 0.0862),
        "thigh": (0.1416, 0.4095, 0.329, 0.329, 0.149, 0.4222),
        "shank": (0.0433, 0.4395, 0.251, 0.246, 0.102, 0.4403),
        "foot": (0.0137, 0.4415, 0.257, 0.245, 0.124, 0.2581),
    },
    "female": {
        "head": (0.0668, 1 - 0.4841, 0.271, 0.295, 0.261, 0.2437),
        "trunk": (0.4257, 1 - 0.3782, 0.379, 0.361, 0.182, 0.4979),
        "upper_trunk": (0.1545, 0.2077, 0.746, 0.502, 0.718, 0.1425),
        "middle_trunk": (0.1465, 0.4512, 0.433, 0.354, 0.415, 0.2053),
        "lower_trunk": (0.1247, 0.4920, 0.433, 0.402, 0.444, 0.1815),
        "upper_arm": (0.0255, 0.5754, 0.278, 0.260, 0.148, 0.2751),
        "forearm": (0.0138, 0.4559, 0.261, 0.257, 0.094, 0.2643),
        "hand": (0.0056, 0.7474, 0.531, 0.454, 0.335, 0.0780),
        "thigh": (0.1478, 0.3612, 0.369, 0.364, 0.162, 0.3685),
        "shank": (0.0481, 0.4352, 0.267, 0.263, 0.092, 0.4386),
        "foot": (0.0129, 0.4014, 0.299, 0.279, 0.139, 0.2283),
    },
}

# Mass, centre from the proximal end, radius across, de Leva's segment of the same shape, length over the height.
_WINTER = {
    "head_and_trunk": (0.578, 0.660, 0.503, "trunk", 0.288),
    "hat": (0.678, 0.626, 0.496, "trunk", 0.288),
    "upper_arm": (0.028, 0.436, 0.322, "upper_arm", 0.0),
    "forearm": (0.016, 0.430, 0.303, "forearm", 0.0),
    "hand": (0.006, 0.506, 0.297, "hand", 0.0),
    "forearm_and_hand": (0.022, 0.682, 0.468, "forearm", 0.0),
    "arm": (0.050, 0.530, 0.368, "upper_arm", 0.0),
    "thigh": (0.100, 0.433, 0.323, "thigh", 0.0),
    "shank": (0.0465, 0.433, 0.302, "shank", 0.0),
    "foot": (0.0145, 0.500, 0.475, "foot", 0.0),
    "leg": (0.161, 0.447, 0.326, "thigh", 0.0),
    "shank_and_foot": (0.061, 0.606, 0.416, "shank", 0.0),
}

# Mass, centre from the proximal end, radii across (two) and along.
_DUMAS = {
    "male": {
        "head": (0.067, 0.555, 0.31, 0.33, 0.25),
        "torso": (0.333, 0.420, 0.27, 0.28, 0.25),
        "pelvis": (0.142, 0.280, 1.01, 0.95, 1.06),
        "upper_arm": (0.024, 0.452, 0.31, 0.32, 0.14),
        "forearm": (0.017, 0.417, 0.28, 0.27, 0.11),
        "hand": (0.006, 0.357, 0.26, 0.24, 0.16),
        "thigh": (0.123, 0.429, 0.29, 0.30, 0.15),
        "shank": (0.048, 0.410, 0.28, 0.28, 0.10),
        "foot": (0.012, 0.436, 0.25, 0.25, 0.11),
    },
    "female": {
        "head": (0.067, 0.597, 0.32, 0.34, 0.27),
        "torso": (0.304, 0.436, 0.29, 0.29, 0.27),
        "pelvis": (0.146, 0.232, 0.91, 0.79, 1.00),
        "upper_arm": (0.022, 0.454, 0.33, 0.33, 0.17),
        "forearm": (0.013, 0.411, 0.26, 0.25, 0.14),
        "hand": (0.005, 0.327, 0.27, 0.25, 0.18),
        "thigh": (0.146, 0.377, 0.31, 0.32, 0.19),
        "shank": (0.045, 0.404, 0.28, 0.28, 0.10),
        "foot": (0.010, 0.443, 0.25, 0.25, 0.12),
    },
}

_HAND = 0.108
"""Length of a hand to its finger tips over the height (Winter), to which Dumas' numbers refer."""

# Mean share of the mass and its standard deviation in %, standard deviation of the centre in % of the length.
_BETWEEN_PERSONS = {
    "head": (7.7, 0.6, 1.8),
    "trunk": (46.2, 3.5, 2.4),
    "upper_arm": (4.0, 0.5, 5.6),
    "forearm": (1.5, 0.3, 7.0),
    "hand": (0.66, 0.32, 9.6),
    "thigh": (13.6, 1.8, 3.5),
    "shank": (4.4, 0.3, 1.2),
    "foot": (2.0, 0.2, 3.8),
}
_LIKE = {"forearm_and_hand": "forearm", "arm": "upper_arm", "leg": "thigh", "shank_and_foot": "shank"}


@cache
def segments(table: str, sex: str) -> dict[str, Segment]:
    """Segments of a table by name.

    Args:
        table: One of `TABLES`.
        sex: One of `SEXES`.

    Raises:
        InputError: There is no such table or sex.
    """
    for value, choices, what in ((table, TABLES, "A table of segments"), (sex, SEXES, "The sex of a table")):
        if value not in choices:
            raise InputError(f"{what} is one of {', '.join(choices)}, got '{value}'.")
    return {"winter": _winter, "deleva": _deleva, "dumas": _dumas}[table](sex)


def spread(name: str, sex: str) -> tuple[float, float]:
    """Standard deviations of a person's segment from a table: spread between persons (Cheng) and between tables.

    Returns:
        Standard deviations of the mass over the mass, and of the centre of mass over the segment's length.
    """
    like = _LIKE.get(name, "trunk" if name in LANDMARKS else name)
    mean, mass, center = _BETWEEN_PERSONS[like]
    alike = [own[name] for own in (segments(table, sex) for table in TABLES) if name in own]
    same_ends = [each for each in alike if each.ends == alike[0].ends and not each.length]
    shares, centers = np.array([each.mass for each in alike]), np.array([each.center for each in same_ends])
    between_shares = float(shares.std(ddof=1) / shares.mean()) if len(shares) > 1 else 0.0
    between_centers = float(centers.std(ddof=1)) if len(centers) > 1 else 0.0
    return float(np.hypot(mass / mean, between_shares)), float(np.hypot(center / 100, between_centers))


def _deleva(sex: str) -> dict[str, Segment]:
    ends = {**_ENDS, "foot": ("heel", "toe tip")}
    out = {}
    for name, (mass, center, sagittal, transverse, along, length) in _DELEVA[sex].items():
        across = _mean(sagittal, transverse)
        # A joint does not end these.
        over_height = length / STATURE[sex] if name in ("head", "hand", "trunk") else 0.0
        out[name] = Segment(mass, center, across, along, ends[name], over_height)
    return out


def _winter(sex: str) -> dict[str, Segment]:
    shape, out = segments("deleva", sex), {}
    for name, (mass, center, across, like, length) in _WINTER.items():
        along = across * shape[like].along / shape[like].across
        out[name] = Segment(mass, center, across, along, _ENDS[name], length)
    return {**out, "hand": replace(out["hand"], length=shape["hand"].length)}


def _dumas(sex: str) -> dict[str, Segment]:
    lengths = {"head": segments("deleva", sex)["head"].length, "hand": _HAND}
    ends = {**_ENDS, "hand": ("wrist", "finger tips")}
    return {
        name: Segment(mass, center, _mean(x, z), along, ends[name], lengths.get(name, 0.0))
        for name, (mass, center, x, z, along) in _DUMAS[sex].items()
    }


def _mean(*radii: float) -> float:
    """Radius of gyration of the mean moment of inertia."""
    return float(np.sqrt(np.mean(np.square(radii))))
