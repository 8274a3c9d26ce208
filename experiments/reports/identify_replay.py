"""Replay of an identification on a page: measured and predicted channels, bodies, and places of findings."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.document.parameter_words import in_words, regrouped_in_words
from experiments.document.replay import Replay, every_nth
from ident.estimate import Estimate
from ident.estimation.units import channel_unit, unit_of
from ident.geometry.inertia import body_index
from ident.judgement.finding import Finding
from ident.parameters.prior import KNOWN, parameters_identified
from ident.tolerances import INTERVAL

LEFT_OUT = " None are drawn where samples were left out."


def replay(result: Estimate) -> Replay:
    """Replay of an estimate's first recording, with the predictions of the estimate and of its rivals."""
    log, part = result.prepared, result.part
    arm, samples, time = log.mechanism, log.samples, log.recording.time
    fits = {
        "predicted": result.fit,
        "with the model's own bodies": result.fit.with_psi(result.fit.equations.from_model[: result.base.rank]),
        "with the updated model's": result.fit.with_psi(result.psi_updated),
    }
    drawn = every_nth(len(time), len(result.channels) * (1 + len(fits)))
    motion = samples.motion[drawn]
    used = np.isin(drawn, log.taken(slice(None)))[:, None]
    predicted = {name: np.where(used, fit.predicted(motion), np.nan) for name, fit in fits.items()}
    included = result.trajectory is not None and bool(result.trajectory.known)
    known = {**KNOWN, **log.recording.known}
    spans = [(time[part.stop], time[-1])] if part.stop < len(time) - log.edge else []
    return Replay(
        mechanism=arm,
        recording=log.recording,
        motion=samples.motion,
        channels=[(channel, channel_unit(channel, arm.tree)) for channel in result.channels],
        drawn=drawn,
        curves={"measured": samples.measured[drawn]} | predicted,
        estimate=result.consistent().phi,
        identified=parameters_identified(arm, result.base, result.covariance, known, included=included),
        spans=spans,
        shaded="held out, not fitted" if spans else "",
        remark="All predictions use the estimated set-up." + LEFT_OUT * (not used.all()),
        parameters=[_parameter(result, k) for k in range(len(result.fit.names))],
        findings=[place(finding, result) for finding in result.findings],
    )


def _parameter(result: Estimate, k: int) -> dict[str, Any]:
    """Text shown for a pressed coefficient: its meaning, value and interval."""
    name, arm, base = result.fit.names[k], result.prepared.mechanism, result.base
    value, std = float(result.fit.values[k]), float(np.sqrt(result.covariance_setup[k, k]))
    own = unit_of(name) or ""
    text = regrouped_in_words(base, k, arm) if k < base.rank else in_words(name, arm)
    text = f"{text[0].upper()}{text[1:]}. Estimate {value:.4g} {own}".rstrip()
    text += f", 95 % interval {value - INTERVAL * std:.4g} to {value + INTERVAL * std:.4g}"
    if k < base.rank:
        text += f"; the model as it came has {float(result.fit.equations.from_model[k]):.4g}"
    body = body_index(name) if k < base.rank else None
    return {
        "name": name,
        "value": value,
        "std": std,
        "text": f"{text}.",
        "body": None if body is None else arm.tree.inertial[body],
    }


def place(finding: Finding, result: Estimate) -> dict[str, Any]:
    """Text and places shown for a pressed finding: body, channels and span of time in the first log, if any."""
    log, at = result.logs[0].log, finding.place
    tree, sensors = log.mechanism.tree, log.recording.sensors
    moved = {body.joint: name for body, name in zip(tree.bodies, tree.names, strict=True) if body.joint}
    touched = [sensors[name].body for name in at.wrenches if name in sensors]
    bodies = [name for name in (*at.bodies, *(moved.get(joint) for joint in at.joints), *touched) if name in tree.names]
    span = at.span if at.log == 0 else None
    kinds = {"body": at.bodies, "joint": at.joints, "wrench": at.wrenches, "channel": at.channels}
    about = [_listed(kind, names) for kind, names in kinds.items() if any(names)]
    about += [f"{at.span[0]:.2f} s to {at.span[1]:.2f} s" + f" of log {at.log + 1}" * (at.log > 0)] if at.span else []
    return {
        "where": f"The finding is about {'; '.join(about)}." if about else "",
        "body": tree.names.index(bodies[0]) if bodies else None,
        "channels": [channel for channel in at.channels if channel in result.channels],
        "span": list(span) if span else None,
    }


def _listed(kind: str, names: Sequence[str]) -> str:
    """Names after their kind, in the singular or plural."""
    several = {"body": "bodies", "wrench": "wrenches"}.get(kind, f"{kind}s")
    return f"{kind if len(names) == 1 else several} {', '.join(names)}"
