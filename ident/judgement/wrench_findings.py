"""Findings on wrenches: frames, unmeasured contacts, weight, offsets, and channels out of a planar model's plane."""

from collections.abc import Iterator

import numpy as np

from ident.estimation.equations import COMPONENTS, channels_out_of_plane
from ident.estimation.units import coefficient_unit
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding
from ident.judgement.place import Place
from ident.parameters.base_parameters import STANDARD_GRAVITY
from ident.tolerances import KILONEWTONS

THROUGH_A_POINT = 0.5
"""Least fraction of the residual moment that forces through one point explain for a contact to be suspected."""

LARGE = 0.3
"""Residual over signal above which a missing contact is considered."""

HEAVY = 0.05
"""Relative difference of the measured mass from the model's from which there is a remark."""

FAR_OFF = 0.3
"""The same from which it is a doubt."""

DRIFT = 0.02
"""Drift of the measured mass over the model's from which there is a remark."""

OFFSET = 0.1
"""Constant offset over the weight, for moments over the weight times the mechanism's reach, that is a doubt."""


def frame_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubts on wrenches of the opposite sign, in rotated axes, or with single components of the opposite sign."""
    total = evidence.checks.total
    if total is not None and total.suspicious:
        yield Finding.of("total_wrench_sign", error=total.error, error_turned=total.error_turned)
    for name, check in evidence.checks.frames.items():
        if check.mirrored:
            place = Place(wrenches=(name,))
            yield Finding.of("mirrored_components", place, wrench=name, components=check.mirrored)
        if not check.suspicious:
            continue
        gravity, opposite = evidence.checks.gravity, check.sign < 0 and np.array_equal(check.rotation, np.eye(3))
        or_else = gravity.rpy_deg if opposite and gravity is not None and gravity.possible else None
        R = evidence.logs[0].recording.wrench(name).pose[:3, :3]
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
    if check.body in {sensor.body for sensor in evidence.logs[0].recording.sensors.values()}:
        return
    # Nothing touches a body further away from it than the mechanism is long.
    if np.linalg.norm(check.point) > _length(evidence):
        return
    values = {"body": check.body, "point": check.point.tolist(), "explained": check.explained}
    yield Finding.of("contact_left_out", Place(bodies=(check.body,)), **values)


def _length(evidence: Evidence) -> float:
    """Reach of the mechanism: distance of the farthest body's frame plus twice that to its centre of mass, m."""
    mechanism = evidence.mechanism
    poses = mechanism.tree.poses(evidence.logs[0].samples.motion.q)[:, list(mechanism.tree.inertial)]
    bodies = mechanism.known.reshape(-1, 10)
    centres = np.linalg.norm(bodies[:, 1:4], axis=1) / np.maximum(bodies[:, 0], 1e-12)
    return float((np.linalg.norm(poses[..., :3, 3], axis=-1) + 2 * centres).max())


def unmeasured_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on samples that were left out because of unmeasured contacts."""
    for k, log in enumerate(evidence.logs):
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


def weight_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on a measured mass that differs from the model's, or drifts, and on forces that are far too small."""
    weight, largest = evidence.checks.weight, evidence.checks.largest_force
    if weight is None:
        return
    if abs(weight.measured - weight.model) > HEAVY * weight.model:
        far = abs(weight.measured - weight.model) > FAR_OFF * weight.model
        yield Finding.of("weight_differs", doubt=far, measured=weight.measured, model=weight.model)
    if abs(weight.drift) > DRIFT * weight.model:
        yield Finding.of("weight_drifts", drift=weight.drift)
    if largest is not None and 0 < largest < evidence.mechanism.weight / KILONEWTONS:
        yield Finding.of("kilonewtons", largest=largest, weight=evidence.mechanism.weight)


def offset_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on constant offsets beyond noise, doubts if they are large relative to the weight."""
    offsets = evidence.offsets
    large = {
        channel: (value, std, coefficient_unit(f"offset({channel})", evidence.mechanism.tree))
        for channel, (value, std) in offsets.items()
        if abs(value) > 4 * std and abs(value) > 0.3 * evidence.scale[channel]
    }
    if not large:
        return
    references = _references(evidence)
    of_weight = {c: abs(offsets[c][0]) / references[c[0]] for c in large if c in COMPONENTS}
    if huge := {c: share for c, share in of_weight.items() if share > OFFSET}:
        own = {c: large[c] for c in huge}
        yield Finding.of("large_offsets", Place(channels=tuple(huge)), offsets=own, shares=huge)
    code = "offsets_taken_out" if evidence.fit.equations.offsets else "offsets_not_fitted"
    yield Finding.of(code, Place(channels=tuple(large)), offsets=large)


def _references(evidence: Evidence) -> dict[str, float]:
    """Sizes with which offsets of forces, `F` in N, and of moments, `M` in N m, are compared.

    Without gravity that is the weight on Earth; without postures the mechanism's reach is not known.
    """
    mechanism = evidence.mechanism
    if not evidence.logs:
        return {"F": mechanism.weight or np.inf, "M": np.inf}
    motion, frame = evidence.logs[0].samples.motion, evidence.logs[0].frame
    g = float(np.linalg.norm(mechanism.gravity) or np.linalg.norm(STANDARD_GRAVITY))
    weight = max(mechanism.mass * g, 1e-12)
    origins = mechanism.tree.poses(motion.q[:: max(1, len(motion) // 100)])[..., :3, 3]
    reach = float(np.linalg.norm(origins - frame[:3, 3], axis=-1).max())
    return {"F": weight, "M": weight * reach if reach > 0 else np.inf}


def plane_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on channels out of the plane of a planar model, and on the option that leaves them out."""
    if not evidence.logs:
        return
    hidden = channels_out_of_plane(evidence.mechanism, evidence.logs[0].frame)
    if set(hidden) & set(evidence.channels):
        place = Place(channels=tuple(name for name in hidden if name in evidence.channels))
        yield Finding.of("out_of_plane", place, normal=hidden[0][1], channels=tuple(hidden))
