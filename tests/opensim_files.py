"""OpenSim files written by the tests: small models in the formats of versions 3 and 4."""

import warnings

import numpy as np
from mechanisms import random_phi
from random_models import numbers

import sim
from ident.geometry.inertia import com_from_parameters
from sim.models.notes import ModelNote


def constant(value):
    return f"<Constant><value>{float(value)!r}</value></Constant>"


def linear(slope, intercept=0.0):
    return f"<LinearFunction><coefficients>{numbers([slope, intercept])}</coefficients></LinearFunction>"


def table(x, y, kind="SimmSpline"):
    return f"<{kind}><x>{numbers(x)}</x><y>{numbers(y)}</y></{kind}>"


def multiplied(function, scale):
    return f"<MultiplierFunction><function>{function}</function><scale>{float(scale)!r}</scale></MultiplierFunction>"


def axis(name, coordinate, direction, function):
    return (
        f'<TransformAxis name="{name}"><coordinates>{coordinate}</coordinates><axis>{numbers(direction)}</axis>'
        f"<function>{function}</function></TransformAxis>"
    )


def spatial(axes):
    """Six (coordinate, direction, function), rotations first."""
    names = [f"{kind}{k}" for kind in ("rotation", "translation") for k in (1, 2, 3)]
    rows = "".join(axis(name, *given) for name, given in zip(names, axes, strict=True))
    return f"<SpatialTransform>{rows}</SpatialTransform>"


def coordinate(name, default=0.0, limits=(-1.5, 1.5), locked=False):
    return (
        f'<Coordinate name="{name}"><default_value>{default!r}</default_value><range>{numbers(limits)}</range>'
        f"<locked>{str(locked).lower()}</locked></Coordinate>"
    )


class Joint:
    """A joint: kind, bodies, a frame on each (position and x, y, z angles), coordinates, and inner XML."""

    def __init__(self, kind, name, parent, child, coordinates=(), inside="", at=None, on=None):
        self.kind, self.name, self.parent, self.child = kind, name, parent, child
        self.coordinates, self.inside = list(coordinates), inside
        self.at, self.on = ((np.zeros(3), np.zeros(3)) if x is None else x for x in (at, on))

    def version_4(self):
        frames = "".join(
            f'<PhysicalOffsetFrame name="{body}_offset"><socket_parent>{path(body)}</socket_parent>'
            f"<translation>{numbers(p)}</translation><orientation>{numbers(r)}</orientation></PhysicalOffsetFrame>"
            for body, (p, r) in ((self.parent, self.at), (self.child, self.on))
        )
        return (
            f'<{self.kind} name="{self.name}"><socket_parent_frame>{self.parent}_offset</socket_parent_frame>'
            f"<socket_child_frame>{self.child}_offset</socket_child_frame>"
            f"<coordinates>{''.join(self.coordinates)}</coordinates><frames>{frames}</frames>{self.inside}</{self.kind}>"
        )

    def version_3(self):
        tags = ("location_in_parent", "orientation_in_parent", "location", "orientation")
        ends = zip(tags, (*self.at, *self.on), strict=True)
        return (
            f'<Joint><{self.kind} name="{self.name}"><parent_body>{self.parent}</parent_body>'
            + "".join(f"<{tag}>{numbers(x)}</{tag}>" for tag, x in ends)
            + f"<CoordinateSet><objects>{''.join(self.coordinates)}</objects></CoordinateSet>{self.inside}"
            f"</{self.kind}></Joint>"
        )


def path(body):
    return "/ground" if body == "ground" else f"/bodyset/{body}"


def inertial(phi, version):
    mass, center, inertia = com_from_parameters(phi)
    entries = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    keys = ("xx", "yy", "zz", "xy", "xz", "yz")
    stated = (
        f"<inertia>{numbers(entries)}</inertia>"
        if version == 4
        else "".join(f"<inertia_{key}>{x!r}</inertia_{key}>" for key, x in zip(keys, entries.tolist(), strict=True))
    )
    return f"<mass>{float(mass)!r}</mass>\n  <mass_center> {numbers(center)}</mass_center>\n  {stated}"


def document(joints, phi, *, version=4, gravity=(0, -9.8, 0), constraints="", markers=()):
    """An OpenSim file of joints, φ by body, the content of its `ConstraintSet`, and markers (name, body, place)."""
    held = {joint.child: joint for joint in joints}
    bodies = "".join(
        f'\n <Body name="{name}">\n  {inertial(own, version)}\n  '
        + (held[name].version_3() if version == 3 else "")
        + "</Body>"
        for name, own in phi.items()
    )
    ground = '<Body name="ground"><mass>0</mass><Joint/></Body>' if version == 3 else ""
    where = "<body>{}</body>" if version == 3 else "<socket_parent_frame>{}</socket_parent_frame>"
    points = "".join(
        f'<Marker name="{name}">{where.format(body if version == 3 else path(body))}'
        f"<location>{numbers(x)}</location></Marker>"
        for name, body, x in markers
    )
    joint_set = (
        "" if version == 3 else f"<JointSet><objects>{''.join(j.version_4() for j in joints)}</objects></JointSet>"
    )
    return (
        f'<?xml version="1.0" encoding="UTF-8" ?>\n<OpenSimDocument Version="{version}0000">\n<Model name="m">\n'
        f"<!-- written for a test -->\n<gravity>{numbers(gravity)}</gravity>\n"
        f"<BodySet><objects>{ground}{bodies}\n</objects></BodySet>\n{joint_set}\n"
        f"<ConstraintSet><objects>{constraints}</objects></ConstraintSet>\n"
        f"<MarkerSet><objects>{points}</objects></MarkerSet>\n"
        "<ForceSet><objects><Thelen2003Muscle name='soleus'><mass>7</mass></Thelen2003Muscle></objects></ForceSet>\n"
        "</Model>\n</OpenSimDocument>\n"
    )


def coupler(leader, follower, function, scale=1.0):
    return (
        f'<CoordinateCouplerConstraint name="couple_{follower}"><isEnforced>true</isEnforced>'
        f"<coupled_coordinates_function>{function}</coupled_coordinates_function>"
        f"<independent_coordinate_names>{leader}</independent_coordinate_names>"
        f"<dependent_coordinate_name>{follower}</dependent_coordinate_name>"
        f"<scale_factor>{scale!r}</scale_factor></CoordinateCouplerConstraint>"
    )


def every_kind(seed, version=4):
    """A model with joints of all kinds, followers, a locked coordinate, and markers, at random places."""
    rng = np.random.default_rng(seed)
    frame = lambda: (rng.normal(size=3) * 0.3, rng.normal(size=3))  # noqa: E731
    frames = lambda: {"at": frame(), "on": frame()}  # noqa: E731
    several = lambda stem, n: [coordinate(f"{stem}_{k}") for k in range(n)]  # noqa: E731
    x = np.linspace(-1.6, 1.6, 9)
    spline = lambda size: table(x, size * np.sin(x + rng.normal()) * rng.uniform(0.5, 1))  # noqa: E731
    turns, slides = (np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2))
    knee = spatial(
        [
            ("bend", turns[0], linear(-1, 0.2)),
            ("bend", turns[1], spline(0.2)),
            ("", turns[2], constant(0.3)),
            ("bend", slides[0], spline(0.05)),
            ("bend", slides[1], multiplied(spline(0.05), 1.3)),
            ("slip", slides[2], linear(0.02, 0.1)),
        ]
    )
    joints = [
        Joint("FreeJoint", "root", "ground", "pelvis", several("free", 6), **frames()),
        Joint("BallJoint", "hip", "pelvis", "thigh", several("ball", 3), **frames()),
        Joint("CustomJoint", "knee", "thigh", "shank", [coordinate("bend"), coordinate("slip")], knee, **frames()),
        Joint("PinJoint", "kneecap", "thigh", "patella", several("beta", 1), **frames()),
        Joint("UniversalJoint", "ankle", "shank", "foot", several("ankle", 2), **frames()),
        Joint("WeldJoint", "mtp", "foot", "toes", **frames()),
        Joint("PlanarJoint", "planar", "pelvis", "plane", several("planar", 3), **frames()),
        Joint("SliderJoint", "slider", "plane", "slide", several("slide", 1), **frames()),
        Joint("GimbalJoint", "gimbal", "slide", "head", several("gimbal", 3), **frames()),
        Joint("PinJoint", "lock", "head", "jaw", [coordinate("jaw_0", 0.4, locked=True)], **frames()),
    ]
    phi = dict(zip((j.child for j in joints), 0.1 * random_phi(rng, len(joints)).reshape(-1, 10), strict=True))
    points = [(f"marker{k}", body, rng.normal(size=3)) for k, body in enumerate(("pelvis", "shank", "toes"))]
    constraint = coupler("bend", "beta_0", spline(0.3), 1.2)
    gravity = (0.3, -9.7, 0.2)
    return document(joints, phi, version=version, gravity=gravity, constraints=constraint, markers=points), phi


def quietly_read(path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelNote)
        return sim.mechanism(path)
