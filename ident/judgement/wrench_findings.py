"""Findings on wrenches: frames, contacts that are not measured, and channels out of a planar model's plane."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ident.arguments import rpy_text
from ident.estimation.equations import channels_out_of_plane
from ident.judgement.evidence import Evidence
from ident.judgement.finding import FINDINGS, Finding, Place, doubt, listed, percent, remark

THROUGH_A_POINT = 0.5
"""Least fraction of the residual moment that forces through one point explain for a contact to be suspected."""

LARGE = 0.3
"""Residual over signal above which a missing contact is considered."""


def frame_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubts on wrenches of the opposite sign, in other axes or frames, or with components of the opposite sign."""
    gravity = evidence.checks.gravity
    for name, check in evidence.checks.frames.items():
        if check.mirrored:
            yield Finding.of("mirrored_components", wrench=name, components=check.mirrored)
        if not check.suspicious:
            continue
        R, straight = evidence.prepared.recording.wrench(name).pose[:3, :3], np.array_equal(check.rotation, np.eye(3))
        frame = "transposed" if np.allclose(check.rotation, R.T @ R.T) else "turned"
        or_else = gravity.rpy_deg if straight and gravity is not None and gravity.possible else None
        yield Finding.of(
            "wrench_sign_or_axes",
            wrench=name,
            opposite=check.sign < 0,
            frame="as stated" if straight else frame,
            axes={axis: _axis(check.rotation[:, k]) for k, axis in enumerate("xyz")},
            error=check.error,
            error_turned=check.error_turned,
            rpy_deg=or_else,
        )
    base = evidence.checks.base
    if base is not None and not any(check.suspicious for check in evidence.checks.frames.values()):
        yield Finding.of("other_base", **base._asdict())


def _axis(direction: np.ndarray) -> str:
    k = int(np.argmax(np.abs(direction)))
    return ("-" if direction[k] < 0 else "") + "xyz"[k]


def contact_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on an unmeasured contact."""
    check = evidence.checks.contact
    if check is None or check.explained < THROUGH_A_POINT or np.median(list(evidence.ratios.values())) < LARGE:
        return
    # Noise of a measured contact is a force through its sensor as well.
    measured = {sensor.body for sensor in evidence.prepared.recording.sensors.values()}
    # Nothing touches a body further away from it than the mechanism is long.
    if check.body not in measured and np.linalg.norm(check.point) <= _length(evidence):
        yield Finding.of("contact_left_out", body=check.body, point=check.point.tolist(), explained=check.explained)


def _length(evidence: Evidence) -> float:
    """Reach of the mechanism: distance of the farthest body's frame plus twice that to its centre of mass, m."""
    mechanism = evidence.mechanism
    poses = mechanism.tree.poses(evidence.prepared.samples.motion.q)[:, list(mechanism.tree.inertial)]
    bodies = mechanism.known.reshape(-1, 10)
    centres = np.linalg.norm(bodies[:, 1:4], axis=1) / np.maximum(bodies[:, 0], 1e-12)
    return float((np.linalg.norm(poses[..., :3, 3], axis=-1) + 2 * centres).max())


def unmeasured_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on samples that were left out because of unmeasured contacts."""
    for k, (log, _) in enumerate(evidence.logs):
        for each in log.left_out:
            place = Place(bodies=(each.body,) if each.body else (), span=(each.start, each.end), log=k)
            yield Finding.of(
                "unmeasured_contact", place, **each._asdict(), log=k + 1 if len(evidence.logs) > 1 else None
            )


def plane_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on channels out of the plane of a planar model, and on the option that leaves them out."""
    hidden = channels_out_of_plane(evidence.mechanism, evidence.prepared.frame)
    if channels := tuple(name for name in hidden if name in evidence.channels):
        yield Finding.of("out_of_plane", Place(channels=channels), normal=hidden[0][1], channels=tuple(hidden))


def _frame(
    wrench: str,
    opposite: bool,
    frame: str,
    axes: Mapping[str, str],
    error: float,
    error_turned: float,
    rpy_deg: Sequence[float] | None = None,
) -> str:
    frames = {
        "as stated": "",
        "transposed": "a transposed frame (its rotation is that of the base in the sensor)",
        "turned": f"a turned frame (axes {listed(f'{own} -> {other}' for own, other in axes.items())})",
    }
    base = f" A base turned to rpy_deg = {rpy_text(rpy_deg)} would look alike." if rpy_deg else ""
    both = " and ".join(filter(None, ["the opposite sign" if opposite else "", frames[frame]]))
    return (
        f"The wrench '{wrench}' seems to have {both}. Its relative error against the model's prediction would fall "
        f"from {error:.2f} to {error_turned:.2f}. Mend its sign or frame in the columns file.{base}"
    )


def _mirrored(wrench: str, components: Sequence[str]) -> str:
    looks, columns = ("looks", "its column") if len(components) == 1 else ("look", "their columns")
    return (
        f"{listed(components, 'components')} of the wrench '{wrench}' {looks} mirrored: the opposite sign is "
        f"far nearer to the model's own prediction. Give {columns} gain = -1 in the columns file."
    )


def _unmeasured(start: float, end: float, carries: float, body: str | None, log: int | None) -> str:
    on, where = f", as on '{body}'" if body else "", "" if log is None else f"Log {log}: "
    return (
        f"{where}From {start:.2f} to {end:.2f} s an unmeasured contact carries up to {percent(carries)} of the "
        f"weight{on}. These samples are left out."
    )


def _out_of_plane(normal: str, channels: Sequence[str]) -> str:
    return (
        f"The model moves in the plane normal to {normal} alone, and cannot explain {listed(channels, 'channels')}. "
        f"Leave them out: --leave-out {' '.join(channels)}."
    )


FINDINGS.update(
    wrench_sign_or_axes=doubt(_frame, wrenches="wrench"),
    mirrored_components=doubt(_mirrored, wrenches="wrench"),
    other_base=doubt(
        "The wrench 'ground' seems to be measured in the frame of '{body}'. There its relative error against the "
        "model's prediction would fall from {error:.2f} to {error_there:.2f}. Try --base {body}.",
        bodies="body",
    ),
    contact_left_out=doubt(
        "A contact may be left out: forces through one point of '{body}' would explain {explained:%} of the residual "
        "moment. In its frame the point is ({point:.2f}) m. Measure that contact, or avoid it.",
        bodies="body",
    ),
    unmeasured_contact=remark(_unmeasured),
    out_of_plane=remark(_out_of_plane),
)
