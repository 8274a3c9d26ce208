"""Trees from modified Denavit-Hartenberg tables (Khalil and Kleinfinger, ICRA 1986; Table I)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ident.annotations import typed
from ident.errors import ModelError
from ident.geometry import se3
from ident.mechanism.body import BASE, Body
from ident.mechanism.loops import Constraints, Relation
from ident.mechanism.tree import Tree

X = np.array([0.0, 0, 0, 1, 0, 0])
Z = np.array([0.0, 0, 0, 0, 0, 1])
ALONG_X = np.array([1.0, 0, 0, 0, 0, 0])
ALONG_Z = np.array([0.0, 0, 1, 0, 0, 0])

JOINT_TWISTS = {"revolute": Z, "prismatic": ALONG_Z, "fixed": np.zeros(6)}
"""Twist of the joint of each kind of frame, in that frame: about or along z, or none."""


@typed("alpha", "d", "theta", "r", "gamma", "b", "constant")
@dataclass(frozen=True)
class Frame:
    """One row of a modified DH table: `T = Rz(γ) Tz(b) Rx(α) Tx(d) Rz(θ) Tz(r)` from the parent frame.

    Attributes:
        name: Name of the frame.
        parent: Name of the frame before it, None for the base frame {0}.
        kind: `revolute` (q adds to θ), `prismatic` (q adds to r) or `fixed`.
        alpha: Angle about the parent's x, rad.
        d: Distance along that x, m.
        theta: Angle about z, rad.
        r: Distance along z, m.
        gamma: Angle about the parent's z before all others, rad; zero in a serial chain.
        b: Distance along that z, m.
        inertia: True if the frame carries a body.
        follows: Factors of the joints of which this one's coordinate is the sum, by their frames' names; empty for a
            joint of its own.
        constant: Constant of that sum, rad or m.
    """

    name: str
    parent: str | None
    kind: str
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    r: float = 0.0
    gamma: float = 0.0
    b: float = 0.0
    inertia: bool = True
    follows: Mapping[str, float] = field(default_factory=dict)
    constant: float = 0.0

    @property
    def home(self) -> np.ndarray:
        """Pose in the parent frame at q = 0 (4, 4)."""
        steps = ((Z, self.gamma), (ALONG_Z, self.b), (X, self.alpha), (ALONG_X, self.d), (Z, self.theta))
        T = np.eye(4)
        for twist, amount in (*steps, (ALONG_Z, self.r)):
            T = T @ se3.exp(twist, amount)
        return T


@typed()
def tree_from_mdh(frames: Sequence[Frame]) -> Tree:
    """Tree of a modified DH table, with fixed frames merged into links.

    Frames that are fixed to one another form one link. A link's body is its first frame with inertia, even if another
    frame has the joint; a link without inertia keeps its joint's frame as a massless body. Further frames with inertia
    are bodies welded to the first one.

    Args:
        frames: The table, parents before their children.

    Returns:
        Bodies named like their frames, joints like the frames that move; q in the order of the table's joints, without
        those that follow others.

    Raises:
        ModelError: A kind is unknown, a name occurs twice, a parent does not come before its child, or a joint follows
            none that moves, or itself.
    """
    _check(frames)
    by_name = {frame.name: frame for frame in frames}
    mover, in_mover = _movers(frames)
    bodies: list[Body] = []
    carrier: dict[str | None, int] = {}

    def in_body(body: int, T: np.ndarray) -> np.ndarray:
        """A pose given in the moving frame of a body's link, expressed in the body's own frame."""
        return T if body == BASE else se3.inverse(in_mover[bodies[body].name]) @ T

    for frame in _bodies(frames, mover):
        link, here = mover[frame.name], in_mover[frame.name]
        if link is None or link in carrier:
            parent = carrier.get(link, BASE)
            home, twist, joint = in_body(parent, here), np.zeros(6), ""
        else:
            row = by_name[link]
            parent = carrier.get(mover[row.parent], BASE)
            home = in_body(parent, in_mover[row.parent]) @ row.home @ here
            twist, joint = se3.Ad(se3.inverse(here)) @ JOINT_TWISTS[row.kind], link
        carrier.setdefault(link, len(bodies))
        bodies.append(Body(frame.name, parent, home, twist, joint, massless=not frame.inertia))
    return _following(Tree(tuple(bodies)), by_name)


def _following(tree: Tree, by_name: Mapping[str, Frame]) -> Tree:
    """The tree with those joints dependent that follow others."""
    owners, rows = {body.joint: body.name for body in tree.bodies}, list[Relation]()
    dependent = tuple(joint for joint in tree.joints if by_name[joint].follows)
    for joint in dependent:
        leads = by_name[joint].follows
        if unknown := [name for name in leads if name == joint or name not in tree.joints]:
            others = ", ".join(name for name in tree.joints if name != joint) or "none"
            raise ModelError(f"Frame '{joint}' needs to follow joints out of {others}, got '{unknown[0]}'.")
        second = tuple((owners[name], float(factor)) for name, factor in leads.items())
        rows.append(Relation(joint, ((owners[joint], 1.0),), second, (by_name[joint].constant, 1.0)))
    constraints = Constraints(tuple(rows), {joint: np.zeros(1) for joint in tree.joints})
    if {*constraints.dependent(tree, dependent)} != {*dependent}:
        raise ModelError(f"The frames {', '.join(dependent)} follow each other; one of them needs a joint of its own.")
    return constraints.closed(tree, dependent) if rows else tree


def _movers(frames: Sequence[Frame]) -> tuple[dict[str | None, str | None], dict[str | None, np.ndarray]]:
    """Name of the moving frame of each frame's link, None for the base frame, and the frame's pose in it (4, 4)."""
    mover: dict[str | None, str | None] = {None: None}
    in_mover: dict[str | None, np.ndarray] = {None: np.eye(4)}
    for frame in frames:
        moves = frame.kind != "fixed"
        mover[frame.name] = frame.name if moves else mover[frame.parent]
        in_mover[frame.name] = np.eye(4) if moves else in_mover[frame.parent] @ frame.home
    return mover, in_mover


def _bodies(frames: Sequence[Frame], mover: dict[str | None, str | None]) -> list[Frame]:
    """Frames that become bodies: those with inertia, and the moving frames of links without any."""
    heavy = {mover[frame.name] for frame in frames if frame.inertia}
    chosen = [
        frame for frame in frames if frame.inertia or (mover[frame.name] == frame.name and frame.name not in heavy)
    ]
    # Bodies are in the order of their links' joints, also if a joint's row comes before its body's.
    return sorted(chosen, key=lambda frame: [f.name for f in frames].index(mover[frame.name] or frame.name))


def _check(frames: Sequence[Frame]) -> None:
    earlier: set[str | None] = {None}
    for row, frame in enumerate(frames, start=1):
        if frame.kind not in JOINT_TWISTS:
            raise ModelError(
                f"Row {row} (frame '{frame.name}') needs a joint type out of {', '.join(JOINT_TWISTS)}, "
                f"got '{frame.kind}'."
            )
        if frame.name in earlier:
            raise ModelError(f"Row {row} gives frame '{frame.name}' a second time; a tree has every frame once.")
        if frame.parent not in earlier:
            known = ", ".join(str(name) for name in earlier if name) or "none but the base"
            raise ModelError(
                f"Row {row} (frame '{frame.name}') needs a parent from a row before it ({known}), got '{frame.parent}'."
            )
        if (frame.follows and frame.kind == "fixed") or (frame.constant and not frame.follows):
            raise ModelError(
                f"Row {row} (frame '{frame.name}') has follows without a joint, or constant without follows; "
                "state zeros by theta or r."
            )
        earlier.add(frame.name)
