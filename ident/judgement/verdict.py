"""Whether to believe an identification, with reasons in plain words."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ident.estimation.equations import COMPONENTS
from ident.judgement.checks import Weight
from ident.parameters.base_parameters import STANDARD_GRAVITY
from ident.parameters.consistency import ConsistentParameters
from ident.tolerances import LEFT, POOR, UNEXPLAINED

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

OFFSET = 0.1
"""Constant offset from which it is a doubt, of the weight, or for moments of the weight at the mechanism's reach."""

FAR = 2.0
"""Distance of the physical bodies from the estimate, over √r as noise would make it, from which it is doubted."""

FACTOR = 2.0
"""By how much a body's mass may differ from the model's without a remark."""

SLIGHT = 1e-3
"""Bodies below this fraction of the whole mass are not worth a remark."""

DRIFT = 0.02
"""Drift of the weighed mass worth a remark, of the model's."""


RESTLESS = 0.3
"""Last step of the joint estimate, in standard deviations, from which it is a doubt that it did not settle."""

OF_THE_MOTION, WORTH_IT = 0.5, 0.02
"""Share of a residual's variance that posture and motion explain, beyond chance, from which it is a doubt, if the
residual is more than so much of the signal."""

BEYOND, RARELY = 0.05, 0.01
"""How far beyond a joint's range, of the range, and for which share of the samples a posture is not worth a word."""

NOTABLY = 1.1
"""Ratio of two residuals from which one prediction is better than another."""

PRECISIONS = 0.1, 0.2, 0.5
"""Standard deviations, of the values, up to which parameters are counted as known."""

WIDER = 2.0
"""How many times the deviation from the noise is to be that with the set-up to be worth a word."""


@dataclass(frozen=True)
class Finding:
    """One thing that speaks against the estimate, or that its reader should know.

    Attributes:
        text: The finding in one sentence.
        doubt: Whether it speaks against the estimate.
    """

    text: str
    doubt: bool

    @property
    def line(self) -> str:
        """A line of a list in the terminal."""
        return f"  {'!' if self.doubt else '-'} {self.text}"


def verdict(result: "Estimate", findings: list[Finding]) -> str:
    """Whether to believe it, and what for."""
    first = sentence(_ratios(result), findings, "held-out")
    return first if first.startswith("Do not use") else f"{first} {' '.join(uses(result))}"


def uses(result: "Estimate") -> Iterator[str]:
    """What the numbers are good for: prediction beside the model's own, and parameters to some precision."""
    if "model" in result.rivals:
        own, model = result.held_out.ratio, result.rivals["model"]
        explained = [c not in result.unexplained for c in result.channels]
        channels = [(c, a, b) for c, a, b, e in zip(result.channels, own, model, explained, strict=True) if e]
        better = [c for c, a, b in channels if a * NOTABLY < b]
        worse = [c for c, a, b in channels if b * NOTABLY < a]
        alike = [c for c, *_ in channels if c not in (*better, *worse)]
        told = ((better, "better than"), (alike, "as well as"), (worse, "worse than"))
        parts = [f"{how} the model as it came in {', '.join(which)}" for which, how in told if which]
        yield f"It predicts {', '.join(parts)}."
    std = result.std_setup
    known = [int((std <= share * np.abs(result.psi)).sum()) for share in PRECISIONS]
    counts = ", ".join(f"{n} within {share:.0%}" for n, share in zip(known, PRECISIONS, strict=True))
    yield f"Of {len(std)} base parameters it knows {counts}."
    wider = [name for name, a, b in zip(result.base.names, result.std, std, strict=True) if b > WIDER * a]
    if wider:
        yield f"What is not known of the set-up more than doubles the deviations of {_listed(wider)}."


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")


def _ratios(result: "Estimate") -> dict[str, float]:
    return dict(zip(result.channels, result.held_out.ratio.tolist(), strict=True))


def sentence(ratios: Mapping[str, float], findings: Sequence[Finding], part: str) -> str:
    """The verdict on channels whose residuals on some part have these ratios to their signals."""
    explained = {channel: ratio for channel, ratio in ratios.items() if ratio <= POOR}
    if not explained:
        return f"Do not use it: the model predicts none of the channels on the {part} part."
    doubts = [finding for finding in findings if finding.doubt]
    if doubts:
        count = "one finding below speaks" if len(doubts) == 1 else f"{len(doubts)} findings below speak"
        return f"Do not use it as it is: {count} against it."
    names = ", ".join(explained)
    return f"Usable: {part} residuals are at most {max(explained.values()):.2f} of the signal in {names}."


def findings(result: "Estimate") -> list[Finding]:
    """All findings on the fit, the doubts first, and then those on the updated model."""
    on_fit = [
        *_frames(result),
        *_base(result),
        *(Finding(each.why, False) for log, _ in result.logs for each in log.left_out),
        *_contact(result),
        *weight_findings(result.checks.weight),
        *_offsets(result),
        *quality_findings(_ratios(result), "held-out"),
        *_setup(result),
        *_fit(result),
        *_posture(result),
        *inseparable_findings(result.inseparable),
        *_stuck(result),
        *(Finding(sentence, False) for sentence in result.checks.unchecked),
        *_caveats(result),
    ]
    on_fit.sort(key=lambda finding: not finding.doubt)
    return [*on_fit, *_masses(result), _consistency(result.consistent())]


def _frames(result: "Estimate") -> Iterator[Finding]:
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
        )


def _base(result: "Estimate") -> Iterator[Finding]:
    check = result.checks.base
    if check is not None and check.suspicious and not any(f.suspicious for f in result.checks.frames.values()):
        yield Finding(
            f"The wrench 'ground' looks as if it were measured in the frame of '{check.body}': --base is probably "
            f"'{check.body}', not what it is now. Against the model's own prediction its relative error would fall "
            f"from {check.error:.2f} to {check.error_there:.2f}.",
            True,
        )


def _axis(direction: np.ndarray) -> str:
    k = int(np.argmax(np.abs(direction)))
    return ("-" if direction[k] < 0 else "") + "xyz"[k]


def _contact(result: "Estimate") -> Iterator[Finding]:
    check = result.checks.contact
    if check is None or check.explained < THROUGH_A_POINT or np.median(result.held_out.ratio) < LARGE:
        return
    point = ", ".join(f"{x:.2f}" for x in check.point)
    yield Finding(
        f"A contact may be left out: forces through one point of body '{check.body}', ({point}) m in its frame, "
        f"would explain {check.explained:.0%} of the residual moment.",
        True,
    )


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


def _offsets(result: "Estimate") -> Iterator[Finding]:
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
    if huge := [f"{large[c]} ({share:.0%})" for c, share in of_weight.items() if share > OFFSET]:
        yield Finding(
            f"Constant offsets are large beside the model's weight, of which or of whose moment at the mechanism's "
            f"reach they are so much: {', '.join(huge)}: a sensor may not be tared, gravity or mass of the model "
            "may be wrong, or a support is not measured.",
            True,
        )
    listed = ", ".join(large.values())
    if fitted:
        yield Finding(f"Constant offsets were found and taken out: {listed}.", False)
    else:
        yield Finding(f"Constant offsets are in the measurements and were not fitted (--offsets does): {listed}.", True)


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


def quality_findings(ratios: Mapping[str, float], part: str) -> Iterator[Finding]:
    """What residuals over signals, of each channel on some part, say."""
    more = "More is left over than the channel varies, as of a constant offset or a sensor that died"
    kinds = (
        (more, LEFT, np.inf, True),
        ("Not explained by this motion", UNEXPLAINED, LEFT, False),
        ("Predicted poorly", POOR, UNEXPLAINED, False),
    )
    for what, low, high, doubt in kinds:
        if listed := ", ".join(f"{channel} ({ratio:.3g})" for channel, ratio in ratios.items() if low < ratio <= high):
            yield Finding(f"{what}, {part} residual over standard deviation in brackets: {listed}.", doubt)


def inseparable_findings(channels: Sequence[str]) -> Iterator[Finding]:
    """A remark on channels whose constant offset cannot be told."""
    if channels:
        yield Finding(
            f"Constant offsets of {', '.join(channels)} cannot be told from masses and first moments: "
            "those take them up.",
            False,
        )


def _stuck(result: "Estimate") -> Iterator[Finding]:
    if result.prepared.stuck:
        yield Finding(
            f"Stuck at one value over the whole log, though the model says that they change, and so left out: "
            f'{", ".join(result.prepared.stuck)}. Mend the sensor, or map what is not connected as missing, by "" in '
            "--columns.",
            True,
        )


def _setup(result: "Estimate") -> Iterator[Finding]:
    """What of the set-up is not as stated."""
    for each in result.setup:
        yield Finding(each.text, False)
    if result.joint is not None and result.joint.search.incredible:
        yield Finding(
            "No set-up near the one that was stated explains the recording, though something is wrong beyond noise: a "
            "contact, a frame, a unit, or the model; the set-up was taken as stated.",
            True,
        )


def _fit(result: "Estimate") -> Iterator[Finding]:
    """How the joint estimate went."""
    if result.joint is None:
        return
    fit = result.joint.fit
    if fit.status == "interrupted" or (fit.status != "converged" and fit.trace[-1] > RESTLESS):
        how = {"interrupted": "was interrupted", "stuck": "found no better step"}.get(fit.status, "did not settle")
        yield Finding(f"The joint estimate {how} after {len(fit.trace)} rounds; its last iterate is given.", True)
    if result.widening > 1:
        yield Finding(
            f"Two halves of the data differ by {result.disagreement:.1f} of their standard deviations from the noise "
            "(root mean square): model or set-up are not quite right, and those deviations are widened by as much.",
            False,
        )
    if result.joint.known:
        yield Finding(
            "The motion does not separate all base parameters; what the model says of its bodies, give or take, was "
            "put in, and those that the data hardly see stay near it.",
            False,
        )
    shares = zip(result.channels, result.model_error, result.held_out.ratio, strict=True)
    if correlated := [c for c, share, ratio in shares if share > OF_THE_MOTION and ratio > WORTH_IT]:
        yield Finding(
            f"Residuals of {', '.join(correlated)} go with the motion: the model is not quite that of the mechanism.",
            True,
        )


def _posture(result: "Estimate") -> Iterator[Finding]:
    """Joints that were recorded beyond the model's ranges."""
    mechanism = result.prepared.mechanism
    beyond = []
    coordinates = mechanism.tree.body_coordinates(result.prepared.samples.motion.q)
    for joint, q in zip((body.joint for body in mechanism.tree.bodies), coordinates, strict=True):
        if joint in mechanism.ranges and q.shape[1] == 1:
            low, high = mechanism.ranges[joint]
            slack = BEYOND * (high - low)
            share = float(((q < low - slack) | (q > high + slack)).mean())
            beyond += [f"{joint} ({share:.0%} of the samples)"] if share > RARELY else []
    if beyond:
        yield Finding(
            f"Joints are recorded beyond the model's ranges: {', '.join(beyond)}; a zero, a sign or a unit may be "
            "wrong.",
            True,
        )


def _caveats(result: "Estimate") -> Iterator[Finding]:
    if result.joint is not None:
        return
    if result.prepared.cutoff is None:
        yield Finding(
            "Velocities and accelerations are the log's own and the wrenches are not filtered: if the log's were, "
            "--cutoff auto treats both alike.",
            False,
        )
    yield Finding(
        "The standard deviations are those of noise on the wrenches; noise on the joint angles biases the estimate "
        "and is not in them.",
        False,
    )


def _consistency(full: ConsistentParameters) -> Finding:
    """What physical consistency has cost."""
    if not full.divergence.any():
        return Finding("The estimate does not contradict the model, whose bodies stay as they are.", False)
    listed = ", ".join(f"{name} by {shift:+.1f}" for name, shift in full.moved(0.1)[:5])
    moves = f"it moves {listed} standard deviations" if listed else "it moves none of them"
    if full.attainable:
        return Finding(f"The updated model has the base parameters within their joint 95 % region: {moves}.", False)
    return Finding(
        f"No physical bodies near the model's have these base parameters; of the updated model's, {moves}.",
        full.distance > FAR * float(np.sqrt(len(full.psi))),
    )


def _masses(result: "Estimate") -> Iterator[Finding]:
    """Bodies that end far from the model's mass, a doubt where the data cannot tell a mass from one so different."""
    full, mechanism = result.consistent(), result.prepared.mechanism
    told: dict[bool, list[str]] = {True: [], False: []}
    masses = zip(mechanism.bodies, full.phi[::10], full.mass_std, mechanism.known[::10], strict=True)
    for name, mass, std, before in masses:
        if max(mass, before) > SLIGHT * full.phi[::10].sum() and not before / FACTOR <= mass <= before * FACTOR:
            was = f"{before:.3g} kg" if before else "none"
            told[bool(2 * std < np.log(FACTOR) * mass)].append(f"{name} {mass:.3g} ± {std:.2g} kg (model: {was})")
    for known, how in ((True, "which the data show"), (False, "though the data hardly see them")):
        if told[known]:
            text = f"Masses beyond a factor of {FACTOR:g} of the model's, {how}: {', '.join(told[known])}."
            yield Finding(text, not known)
