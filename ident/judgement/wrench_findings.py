"""What the wrenches of a recording look like: their frames, what they weigh, their offsets."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ident.estimation.equations import COMPONENTS
from ident.judgement.checks import Weight
from ident.judgement.finding import Finding, Place
from ident.parameters.base_parameters import STANDARD_GRAVITY

if TYPE_CHECKING:
    from ident.estimate import Estimate

THROUGH_A_POINT = 0.5
"""Fraction of the residual moment that forces through one point have to explain before a contact is suspected."""

LARGE = 0.3
"""Residual over signal from which a residual is worth explaining by something missing."""

HEAVY = 0.05
"""Difference between weighed and modelled mass worth a remark, of the latter."""

FAR_OFF = 0.3
"""The same from which it is a doubt."""

DRIFT = 0.02
"""Drift of the weighed mass worth a remark, of the model's."""

OFFSET = 0.1
"""Constant offset from which it is a doubt, of the weight, or for moments of the weight at the mechanism's reach."""


def frame_findings(result: "Estimate") -> Iterator[Finding]:
    """Wrenches of the opposite sign, or in turned axes."""
    for name, check in result.checks.frames.items():
        if not check.suspicious:
            continue
        R = result.prepared.recording.wrench(name).pose[:3, :3]
        if np.array_equal(check.rotation, np.eye(3)):
            what = ""
        elif np.allclose(check.rotation, R.T @ R.T):
            what = "a frame that is transposed (its rotation is that of the base in the sensor)"
        else:
            axes = ", ".join(f"{a} -> {_axis(check.rotation[:, k])}" for k, a in enumerate("xyz"))
            what = f"a frame that is turned (its axes look like {axes})"
        both = " and ".join(filter(None, ["the opposite sign" if check.sign < 0 else "", what]))
        yield Finding(
            f"The wrench '{name}' looks as if it had {both}: against the model's own prediction its relative error "
            f"would fall from {check.error:.2f} to {check.error_turned:.2f}.",
            True,
            Place(wrenches=(name,)),
        )


def base_findings(result: "Estimate") -> Iterator[Finding]:
    """A ground wrench that was measured in the frame of another body."""
    check = result.checks.base
    if check is not None and check.suspicious and not any(f.suspicious for f in result.checks.frames.values()):
        yield Finding(
            f"The wrench 'ground' looks as if it were measured in the frame of '{check.body}': --base is probably "
            f"'{check.body}', not what it is now. Against the model's own prediction its relative error would fall "
            f"from {check.error:.2f} to {check.error_there:.2f}.",
            True,
            Place(bodies=(check.body,)),
        )


def _axis(direction: np.ndarray) -> str:
    k = int(np.argmax(np.abs(direction)))
    return ("-" if direction[k] < 0 else "") + "xyz"[k]


def contact_findings(result: "Estimate") -> Iterator[Finding]:
    """A contact that was not measured."""
    check = result.checks.contact
    if check is None or check.explained < THROUGH_A_POINT or np.median(result.held_out.ratio) < LARGE:
        return
    # Noise of a measured contact is a force through its sensor as well.
    if check.body in {sensor.body for sensor in result.prepared.recording.sensors.values()}:
        return
    # Nothing touches a body further away from it than the mechanism is long.
    if np.linalg.norm(check.point) > _length(result):
        return
    point = ", ".join(f"{x:.2f}" for x in check.point)
    yield Finding(
        f"A contact may be left out: forces through one point of body '{check.body}', ({point}) m in its frame, "
        f"would explain {check.explained:.0%} of the residual moment.",
        True,
        Place(bodies=(check.body,)),
    )


def _length(result: "Estimate") -> float:
    """Largest distance of a body's frame from the base, and from it as far again as twice to its centre of mass, m."""
    mechanism = result.prepared.mechanism
    poses = mechanism.tree.poses(result.prepared.samples.motion.q)[:, list(mechanism.tree.inertial)]
    bodies = mechanism.known.reshape(-1, 10)
    centres = np.linalg.norm(bodies[:, 1:4], axis=1) / np.maximum(bodies[:, 0], 1e-12)
    return float((np.linalg.norm(poses[..., :3, 3], axis=-1) + 2 * centres).max())


def weight_findings(weight: Weight | None) -> Iterator[Finding]:
    """What the weighed mass says."""
    if weight is None:
        return
    if abs(weight.measured - weight.model) > HEAVY * weight.model:
        yield Finding(
            f"The wrenches weigh {weight.measured:.2f} kg, the model {weight.model:.2f} kg: a contact or support "
            "may be unmeasured, a unit may be wrong, or the model is of somebody else.",
            abs(weight.measured - weight.model) > FAR_OFF * weight.model,
        )
    if abs(weight.drift) > DRIFT * weight.model:
        yield Finding(
            f"The weighed mass drifts by {weight.drift:+.2f} kg over the recording, as an unmeasured contact or a "
            "drifting sensor would make it.",
            True,
        )


def fitted_offset_findings(result: "Estimate") -> Iterator[Finding]:
    """What the constant offsets of an estimate say."""
    scale = dict(zip(result.channels, result.scale.tolist(), strict=True))
    fitted = any(name.startswith("offset(") for name in result.names)
    yield from offset_findings(result.offsets, scale, _weights(result), fitted=fitted)


def offset_findings(
    offsets: Mapping[str, tuple[float, float]],
    scale: Mapping[str, float],
    weights: Mapping[str, float],
    *,
    fitted: bool = True,
) -> Iterator[Finding]:
    """What constant offsets say.

    Args:
        offsets: Offset of each channel that can be told, with its standard deviation.
        scale: Standard deviation of each channel's residual.
        weights: What offsets of forces, `F` in N, and of moments, `M` in N m, are held against.
        fitted: Whether they were taken out.
    """
    large = {
        channel: f"{channel} {value:.3g} ± {std:.2g} {_unit(channel)}".rstrip()
        for channel, (value, std) in offsets.items()
        if abs(value) > 4 * std and abs(value) > 0.3 * scale[channel]
    }
    if not large:
        return
    of_weight = {c: abs(offsets[c][0]) / weights[c[0]] for c in large if c in COMPONENTS}
    if huge := {c: f"{large[c]} ({share:.0%})" for c, share in of_weight.items() if share > OFFSET}:
        yield Finding(
            f"Constant offsets are large beside the model's weight, of which or of whose moment at the mechanism's "
            f"reach they are so much: {', '.join(huge.values())}: a sensor may not be tared, gravity or mass of the "
            "model may be wrong, or a support is not measured.",
            True,
            Place(channels=tuple(huge)),
        )
    listed, place = ", ".join(large.values()), Place(channels=tuple(large))
    if fitted:
        yield Finding(f"Constant offsets were found and taken out: {listed}.", False, place)
    else:
        text = f"Constant offsets are in the measurements and were not fitted (--offsets does): {listed}."
        yield Finding(text, True, place)


def _weights(result: "Estimate") -> dict[str, float]:
    """What offsets are held against; without gravity the weight on Earth."""
    mechanism, motion = result.prepared.mechanism, result.prepared.samples.motion
    g = float(np.linalg.norm(mechanism.gravity) or np.linalg.norm(STANDARD_GRAVITY))
    weight = max(mechanism.mass * g, 1e-12)
    origins = mechanism.tree.poses(motion.q[:: max(1, len(motion) // 100)])[..., :3, 3]
    reach = float(np.linalg.norm(origins - result.prepared.frame[:3, 3], axis=-1).max())
    return {"F": weight, "M": weight * reach if reach > 0 else np.inf}


def _unit(channel: str) -> str:
    return {"F": "N", "M": "N m"}.get(channel[0], "") if channel in COMPONENTS else ""
