"""Joints that follow another one, whose column they share or to which the model couples them, or a servo's command."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ident.errors import LogError
from ident.files.table import Columns, Sum, combined
from ident.mechanism.body import Follower
from ident.mechanism.closure import Closure
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.recordings.mapping import ColumnMapping, check_no_column_twice
from ident.recordings.recording import Recording
from ident.recordings.smoothing import white_noise
from ident.recordings.stated import Servo, model_servo
from ident.recordings.times import GAP, Sampled

EXACT = 1e-12
"""Noise of a position beside the estimated one, rad or m, so that exact ones have finite weights."""

LOOSE = 3.0
"""Difference from closed loops over the noise, by their medians, above which a column contradicts them: of normal noise
the ratio is 0.67, play and wrong places of pins make it larger."""

OUTLYING = 5.0
"""Difference over the noise above which a sample does not count."""

MOTION = ("position", "velocity", "acceleration")
"""Quantities of a joint that a follower has from its leader."""


def with_followers(mapping: ColumnMapping, joints: Mapping[str, str]) -> ColumnMapping:
    """The mapping without the columns of followers, whose torques add to their leaders'.

    A joint that has a torque and is a curve of another one does not follow, but depends on it as in a loop. Of joints
    that share a column of positions, the first that has a torque or a command leads.

    Args:
        mapping: The complete mapping, with the model's couplings as its followers.
        joints: Kind of each joint whose positions the mapping states; others share none, as after a slip.

    Raises:
        LogError: A follower has a command, or an uncertain torque; or a column of torques is used twice.
    """
    columns = dict(mapping.columns)
    check_no_column_twice({key: used for key, used in columns.items() if key.rpartition(".")[2] not in MOTION})
    followers = {
        joint: lead
        for joint, lead in mapping.followers.items()
        if not (_position(columns, joint).read or (len(lead.coefficients) > 2 and _of(columns, joint, "torque").read))
    }
    followers |= _sharing(columns, {joint: kind for joint, kind in joints.items() if kind != "ball"})
    for joint, lead in followers.items():
        if joint in mapping.servos or joint in mapping.scales or _of(columns, joint, "command").read:
            raise LogError(
                f"joint '{joint}' follows '{lead.joint}': state commands, gains and deviations of torques for "
                f"'{lead.joint}' alone."
            )
        for kind in (*MOTION, "command"):
            columns.pop(f"joints.{joint}.{kind}", None)
        own, of_leader = columns.pop(f"joints.{joint}.torque", Columns(("",))), _of(columns, lead.joint, "torque")
        if own.read and len(lead.coefficients) == 2:
            of_own = 1.0 if of_leader.read else 0.0
            columns[f"joints.{lead.joint}.torque"] = combined((of_own, lead.coefficients[1]), (of_leader, own))
    return replace(mapping, columns=columns, followers=followers)


def moved(mapping: ColumnMapping, mechanism: Mechanism) -> Mechanism:
    """The mechanism in which joints without a column follow others, or depend on them by loops.

    Raises:
        ModelError: As for `Mechanism.closed`.
    """
    lacking = [joint for joint in mechanism.tree.joints if not _position(mapping.columns, joint).read]
    driven = [joint for joint in mechanism.tree.joints if _is_driven(mapping.columns, joint)]
    followers = {joint: lead for joint, lead in mapping.followers.items() if joint in lacking}
    return mechanism.following(followers).closed(lacking, driven)


def moving(mechanism: Mechanism, recording: Recording) -> tuple[Mechanism, Recording, list[str]]:
    """The mechanism as it moves in a recording, with its loops closed along it, the recording, and sentences on these.

    Of the recording, positions of independent joints are those that measured dependent ones make more certain.

    Raises:
        ModelError: As for `Mechanism.closed` and `Closure.along`.
        LogError: A dependent joint has a torque or a command.
    """
    before, measured, followers = mechanism.tree.joints, recording.measured, recording.followers
    driven = [joint for joint in before if f"{joint}_torque" in measured or joint in recording.servos]
    lacking = [joint for joint in before if f"{joint}_position" not in measured]
    mechanism = mechanism.following(followers).closed(lacking, driven)
    closure, both = mechanism.tree.closure, sorted({*driven} & {*mechanism.tree.dependent, *followers})
    if closure and not closure.independent and (both or not mechanism.tree.joints):
        raise closure.rigid()
    if both:
        leads = closure.independent if closure else [followers[both[0]].joint]
        raise LogError(
            f"Loops make '{both[0]}' depend on {', '.join(leads)}: its torque or command cannot be used. "
            "Log its position in place of theirs, or take it out of the log or the mapping."
        )
    tree, recording, notes = _along(mechanism.tree, recording)
    mechanism = replace(mechanism, tree=tree)
    if carrier := mechanism.carrier:
        lacking = [joint for joint in carrier.joints if f"{joint}_position" not in measured]
        tree, recording, more = _along(carrier.constraints.closing(carrier.tree, lacking), recording)
        mechanism, notes = replace(mechanism, carrier=replace(carrier, tree=tree)), more + notes
    return mechanism, recording, notes


def _along(tree: Tree, recording: Recording) -> tuple[Tree, Recording, list[str]]:
    """A tree with its loops closed along a recording, the recording as for `moving`, and sentences on them."""
    if (closure := tree.closure) is None:
        return tree, recording, []
    x = recording.of_joints(closure.independent, "position")
    closure, leads = closure.along(x, recording.time), ", ".join(closure.independent) or "no joint"
    x, notes = _fused(closure, recording, x)
    if notes:
        fused = {f"{joint}_position": column for joint, column in zip(closure.independent, x.T, strict=True)}
        recording = replace(recording, measured={**recording.measured, **fused})
    names = ", ".join(f"'{each.name}'" for each in closure.constraints)
    first = f"{', '.join(closure.dependent)} depend on {leads}, by the constraints {names}."
    return replace(tree, closure=closure), recording, [first, *notes]


def _fused(closure: Closure, recording: Recording, x: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Independent coordinates (N, n) with what columns of dependent joints add, and sentences on these.

    Of the coordinates' errors e, a dependent joint's column shows y - y(x) = e_y - G e but for a constant: its zero.
    """
    every = enumerate(f"{joint}_position" for joint in closure.dependent)
    columns = {k: name for k, name in every if name in recording.measured}
    own = [f"{joint}_position" for joint in closure.independent]
    if not columns or recording.still or {*columns.values(), *own} & {*recording.streams} or x.shape[1] != len(own):
        return x, []
    y, std = closure.solved(x), EXACT + np.array([white_noise(column, robust=True) for column in x.T])
    G, notes = closure.slopes(x, y), list[str]()
    precision, right = np.zeros((len(x), len(own), len(own))) + np.diag(std**-2), np.zeros_like(x)
    for k, name in columns.items():
        apart, noise, g = recording[name] - y[:, k], EXACT + white_noise(recording[name], robust=True), G[:, k]
        zero, expected = round(float(np.nanmedian(apart)), 12), np.sqrt(noise**2 + g**2 @ std**2)
        joint, off = name.removesuffix("_position"), np.nan_to_num(apart - zero, nan=np.inf)
        counts = np.median(abs(off)) <= LOOSE * np.median(expected)
        weight = np.where(counts & (abs(off) < OUTLYING * expected), noise**-2, 0)
        precision += weight[:, None, None] * g[:, :, None] * g[:, None, :]
        right += (weight * np.where(weight > 0, off, 0))[:, None] * g
        notes.append(
            f"The column of '{joint}' counts too, as loops are closed, but for a constant of {zero:.2g}."
            if counts
            else f"The column of '{joint}' is not used: it differs from the closed loops by {off.std():.2g} (rms) "
            f"beside a constant of {zero:.2g}; its noise is {noise:.2g}."
        )
    return x + np.linalg.solve(precision, right[..., None])[..., 0], notes


def follower_notes(followers: Mapping[str, Follower]) -> list[str]:
    """Sentences on the joints that follow another one."""
    return [
        f"'{joint}' follows '{lead.joint}': {joint} = {_polynomial(lead)}. A torque of '{lead.joint}' moves both."
        for joint, lead in followers.items()
    ]


def _sharing(columns: Mapping[str, Columns], joints: Mapping[str, str]) -> dict[str, Follower]:
    """Followers of joints with the same column of positions."""
    users: dict[str, list[str]] = {}
    for joint in joints:
        if len(names := _position(columns, joint).alone) == 1 and _position(columns, joint).read == names:
            users.setdefault(names[0], []).append(joint)
    out = {}
    for several in users.values():
        leader = next((joint for joint in several if _is_driven(columns, joint)), several[0])
        gain, constant = _position(columns, leader).line
        for joint in (each for each in several if each != leader):
            own, offset = _position(columns, joint).line
            out[joint] = Follower(leader, (offset - own / gain * constant, own / gain))
    return out


def _is_driven(columns: Mapping[str, Columns], joint: str) -> bool:
    return any(_of(columns, joint, kind).read for kind in ("torque", "command"))


def _position(columns: Mapping[str, Columns], joint: str) -> Columns:
    return _of(columns, joint, "position")


def _of(columns: Mapping[str, Columns], joint: str, kind: str) -> Columns:
    return columns.get(f"joints.{joint}.{kind}", Columns(("",)))


def _polynomial(lead: Follower) -> str:
    powers = [lead.joint, *(f"{lead.joint}^{k}" for k in range(2, len(lead.coefficients)))]
    constant, *weights = lead.coefficients
    return Sum(tuple(powers[: len(weights)]), tuple(weights), constant).name


FAR_APART = 20.0
"""Range of commands over that of the positions from which their units differ."""


def with_servos(recording: Recording, servos: Mapping[str, Servo], mechanism: Mechanism, notes: list[str]) -> Recording:
    """Recording with the servos of its commanded joints, and without commands that give no torque.

    Args:
        recording: The recording, with channels `JOINT_command`.
        servos: Servos that the log's mapping states, by joint; others are those of the model's position actuators.
        mechanism: The mechanism.
        notes: Sentences on what was detected; more are appended.

    Raises:
        LogError: Commands and positions are in different units, or nothing but commands without gains is measured.
    """
    commanded = [joint for joint in mechanism.tree.joints if f"{joint}_command" in recording.measured]
    used, unused = dict[str, Servo](), list[str]()
    for joint in commanded:
        servo = servos.get(joint) or model_servo(mechanism, joint)
        if servo is None or f"{joint}_torque" in recording.measured:
            unused.append(joint)
        else:
            _check_unit_of_command(recording, joint)
            used[joint] = servo
            notes += _rare_commands(recording, joint)
    if without := [joint for joint in unused if f"{joint}_torque" not in recording.measured]:
        note = (
            f"Commands of {', '.join(without)} are not used: the model has no position actuator with a gear of 1 for "
            "them, and no kp is stated under [joints.NAME]."
        )
        if not (used or recording.wrenches or recording.torques(mechanism.tree.joints) is not None):
            raise LogError(f"nothing is left to fit. {note}")
        notes.append(note)
    recording = recording.without([f"{joint}_command" for joint in unused])
    measured, streams = dict(recording.measured), dict(recording.streams)
    for body in (body for body in mechanism.tree.bodies if body.joint in used and body.turns):
        command = f"{body.joint}_command"
        # A command that is unwrapped may be whole turns away from its position.
        turns = 2 * np.pi * np.round(np.median(measured[command] - measured[f"{body.joint}_position"]) / (2 * np.pi))
        measured[command] = measured[command] - turns
        if command in streams:
            streams[command] = Sampled(streams[command].time, streams[command].values - turns)
    scales = {joint: std for joint, std in recording.scales.items() if joint not in without}
    return replace(recording, measured=measured, streams=streams, servos=used, scales=scales)


def _rare_commands(recording: Recording, joint: str) -> list[str]:
    """A sentence on commands that come more rarely than positions, of which a log may have left out some."""
    time, values = recording.as_measured(f"{joint}_command")
    step = float(np.median(np.diff(time[np.isfinite(values)])))
    if step <= GAP / recording.rate:
        return []
    return [
        f"Commands of '{joint}' come every {step:.3g} s, more rarely than its positions, and count as held in between. "
        "If the log keeps only some of them, inertias are wrong: log every command."
    ]


def _check_unit_of_command(recording: Recording, joint: str) -> None:
    command, position = recording[f"{joint}_command"], recording[f"{joint}_position"]
    size, usual = (float(np.abs(x).max()) for x in (command, position))
    if size > FAR_APART * usual > 0 and np.ptp(command) > FAR_APART * np.ptp(position):
        raise LogError(
            f"the commands of joint '{joint}' reach {size:.3g}, its positions {usual:.3g}; both need one unit: map the "
            f'command with its own, as in command = {{ column = ..., unit = "deg" }} under [joints.{joint}].'
        )
