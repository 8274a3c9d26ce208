"""Findings on wrenches: frames, contacts that are not measured, and channels out of a planar model's plane."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ident.arguments import rpy_text
from ident.estimation.equations import channels_out_of_plane
from ident.judgement.evidence import Evidence
from ident.judgement.finding import FINDINGS, Finding, Place, Row, listed, percent

THROUGH_A_POINT = 0.5
"""Least fraction of the residual moment that forces through one point explain for a contact to be suspected."""

LARGE = 0.3
"""Residual over signal above which a missing contact is considered."""


def frame_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubts on wrenches of the opposite sign, in rotated axes, or with single components of the opposite sign."""
    for name, check in evidence.checks.frames.items():
        if check.mirrored:
            place = Place(wrenches=(name,))
            yield Finding.of("mirrored_components", place, wrench=name, components=check.mirrored)
        if not check.suspicious:
            continue
        gravity, opposite = evidence.checks.gravity, check.sign < 0 and np.array_equal(check.rotation, np.eye(3))
        or_else = gravity.rpy_deg if opposite and gravity is not None and gravity.possible else None
        R = evidence.prepared.recording.wrench(name).pose[:3, :3]
        frame = "transposed" if np.allclose(check.rotation, R.T @ R.T) else "turned"
        yield Finding.of(
            "wrench_sign_or_axes",
            Place(wrenches=(name,)),
            wrench=name,
            opposite=check.sign < 0,
            frame="as stated" if np.array_equal(check.rotation, np.eye(3)) else frame,
            axes={axis: _axis(check.rotation[:, k]) for k, axis in enumerate("xyz")},
            error=check.error,
            error_turned=check.error_turned,
            rpy_deg=or_else,
        )


def base_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on a ground wrench that was measured in the frame of another body."""
    check = evidence.checks.base
    if check is not None and check.suspicious and not any(f.suspicious for f in evidence.checks.frames.values()):
        place = Place(bodies=(check.body,))
        yield Finding.of("other_base", place, body=check.body, error=check.error, error_there=check.error_there)


def _axis(direction: np.ndarray) -> str:
    k = int(np.argmax(np.abs(direction)))
    return ("-" if direction[k] < 0 else "") + "xyz"[k]


def contact_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on an unmeasured contact."""
    check = evidence.checks.contact
    if check is None or check.explained < THROUGH_A_POINT or np.median(list(evidence.ratios.values())) < LARGE:
        return
    # Noise of a measured contact is a force through its sensor as well.
    if check.body in {sensor.body for sensor in evidence.prepared.recording.sensors.values()}:
        return
    # Nothing touches a body further away from it than the mechanism is long.
    if np.linalg.norm(check.point) > _length(evidence):
        return
    values = {"body": check.body, "point": check.point.tolist(), "explained": check.explained}
    yield Finding.of("contact_left_out", Place(bodies=(check.body,)), **values)


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
        for start, end, carries, body in log.left_out:
            yield Finding.of(
                "unmeasured_contact",
                Place(bodies=(body,) if body else (), span=(start, end), log=k),
                start=start,
                end=end,
                carries=carries,
                body=body,
                log=k + 1 if len(evidence.logs) > 1 else None,
            )


def plane_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on channels out of the plane of a planar model, and on the option that leaves them out."""
    hidden = channels_out_of_plane(evidence.mechanism, evidence.prepared.frame)
    if set(hidden) & set(evidence.channels):
        place = Place(channels=tuple(name for name in hidden if name in evidence.channels))
        yield Finding.of("out_of_plane", place, normal=hidden[0][1], channels=tuple(hidden))


def _frame(
    wrench: str,
    opposite: bool,
    frame: str,
    axes: Mapping[str, str],
    error: float,
    error_turned: float,
    rpy_deg: Sequence[float] | None = None,
) -> str:
    turned = listed(f"{own} -> {other}" for own, other in axes.items())
    frames = {
        "as stated": "",
        "transposed": "a transposed frame (its rotation is that of the base in the sensor)",
        "turned": f"a turned frame (axes {turned})",
    }
    base = f" A base turned to rpy_deg = {rpy_text(rpy_deg)} would look alike." if rpy_deg else ""
    both = " and ".join(filter(None, ["the opposite sign" if opposite else "", frames[frame]]))
    return (
        f"The wrench '{wrench}' seems to have {both}. Its relative error against the model's prediction would fall "
        f"from {error:.2f} to {error_turned:.2f}. Mend its sign or frame in the columns file.{base}"
    )


def _mirrored(wrench: str, components: Sequence[str]) -> str:
    one = len(components) == 1
    return (
        f"{listed(components, 'components')} of the wrench '{wrench}' {'looks' if one else 'look'} mirrored: the "
        f"opposite sign is far nearer to the model's own prediction. Give {'its column' if one else 'their columns'} "
        "gain = -1 in the columns file."
    )


def _contact(body: str, point: Sequence[float], explained: float) -> str:
    at = listed(f"{x:.2f}" for x in point)
    return (
        f"A contact may be left out: forces through one point of '{body}' would explain {percent(explained)} of the "
        f"residual moment. In its frame the point is ({at}) m. Measure that contact, or avoid it."
    )


def _unmeasured(start: float, end: float, carries: float, body: str | None, log: int | None) -> str:
    on = f", as on '{body}'" if body else ""
    where = "" if log is None else f"Log {log}: "
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
    wrench_sign_or_axes=Row(_frame, doubt=True),
    mirrored_components=Row(_mirrored, doubt=True),
    other_base=Row(
        "The wrench 'ground' seems to be measured in the frame of '{body}'. There its relative error against the "
        "model's prediction would fall from {error:.2f} to {error_there:.2f}. Try --base {body}.",
        doubt=True,
    ),
    contact_left_out=Row(_contact, doubt=True),
    unmeasured_contact=Row(_unmeasured, doubt=False),
    out_of_plane=Row(_out_of_plane, doubt=False),
)
