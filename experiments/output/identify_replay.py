"""What a page replays of an identification: measured and predicted channels, bodies, and where findings are."""

import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from experiments.output.figures import PARAMETER, body_index
from experiments.output.layout import unit_of
from experiments.output.parameter_words import in_words, regrouped_in_words
from experiments.output.replay import Replay, every_nth
from experiments.studies.errors import HALF_WIDTH
from ident.estimate import Estimate
from ident.estimation.equations import COMPONENTS
from ident.parameters.prior import KNOWN, parameters_told


def replay(result: Estimate) -> Replay:
    """The first recording of an estimate, with what the estimate and its rivals predict of it."""
    log, part = result.logs[0]
    arm, samples, time = log.mechanism, log.samples, log.recording.time
    fits = {
        "predicted": result.fit,
        "with the model's own bodies": result.fit.with_psi(result.base.regroup(arm.known)),
        "with the updated model's": result.fit.with_psi(result.consistent().psi),
    }
    drawn = every_nth(len(time), len(result.channels) * (1 + len(fits)))
    motion = samples.motion[drawn]
    included = result.joint is not None and bool(result.joint.known)
    known = {**KNOWN, **log.recording.known}
    return Replay(
        mechanism=arm,
        recording=log.recording,
        motion=samples.motion,
        channels=[(channel, channel_unit(result, channel)) for channel in result.channels],
        drawn=drawn,
        curves={"measured": samples.measured[drawn]} | {name: fit.predicted(motion) for name, fit in fits.items()},
        estimate=result.consistent().phi,
        told=parameters_told(arm, result.base, result.covariance, known, included=included),
        spans=[(time[part.stop], time[-1])] if part.stop < len(time) - log.edge else [],
        shaded="held out, and only predicted",
        remark="All predictions take the set-up as it was found.",
        parameters=[_parameter(result, k) for k in range(len(result.names))],
        findings=[place(finding.text, result) for finding in result.findings],
    )


def channel_unit(result: Estimate, channel: str) -> str:
    """Unit of a channel: a component of a wrench, or a joint's torque or force."""
    if channel in COMPONENTS:
        return "N" if channel[0] == "F" else "N m"
    tree = result.prepared.mechanism.tree
    motion = np.hstack([body.motions for body in tree.bodies if body.freedoms])[:, tree.freedoms.index(channel)]
    return "N m" if motion[3:].any() else "N"


def _parameter(result: Estimate, k: int) -> dict[str, Any]:
    """What a press on a coefficient tells: what it is, its value and its interval."""
    name, arm, base = result.names[k], result.prepared.mechanism, result.base
    value, std = float(result.fit.values[k]), float(np.sqrt(result.covariance_setup[k, k]))
    own = unit_of(name) or ""
    text = regrouped_in_words(base, k, arm) if k < base.rank else in_words(name, arm)
    text = f"{text[0].upper()}{text[1:]}. Estimate {value:.4g} {own}".rstrip()
    text += f", 95 % interval {value - HALF_WIDTH * std:.4g} to {value + HALF_WIDTH * std:.4g}"
    if k < base.rank:
        text += f"; the model as it came has {float(base.regroup(arm.known)[k]):.4g}"
    body = body_index(name) if k < base.rank else None
    return {
        "name": name,
        "value": value,
        "std": std,
        "text": f"{text}.",
        "body": None if body is None else arm.tree.inertial[body],
    }


def place(text: str, result: Estimate) -> dict[str, Any]:
    """Where a finding is, by the names in its sentence: body, channels, span of time; nothing where it has none."""
    log = result.prepared
    tree, sensors = log.mechanism.tree, log.recording.sensors
    on = {body.joint: i for i, body in enumerate(tree.bodies) if body.joint}
    on |= {name: tree.names.index(each.body) for name, each in sensors.items() if each.body is not None}
    on |= {name: i for i, name in enumerate(tree.names)}
    # Many a body is called by a word that sentences have too, as base: quotes or a number tell a name.
    bodies = [on[name] for name in _named(text, on, r"'{0}'|(?<!\w){0}(?= [\d(])")]
    if not bodies and (parameter := PARAMETER.search(text)):
        bodies = [tree.inertial[index] for index in [body_index(parameter[0])] if index is not None]
    channels = _named(text, result.channels, r"(?<!\w){0}(?!\w)")
    span = next(([each.start, each.end] for each in log.left_out if each.why == text), None)
    about = [f"body {tree.names[bodies[0]]}"] if bodies else []
    about += [f"channel{'s' * (len(channels) > 1)} {', '.join(channels)}"] if channels else []
    about += [f"{span[0]:.2f} s to {span[1]:.2f} s"] if span else []
    return {
        "where": f"The finding is about {'; '.join(about)}." if about else "",
        "body": bodies[0] if bodies else None,
        "channels": channels,
        "span": span,
    }


def _named(text: str, names: Iterable[str], pattern: str) -> list[str]:
    """Those of some names that a text has in the surroundings of a pattern, in the order of the text."""
    found = {name: re.search(pattern.format(re.escape(name)), text) for name in names if name}
    places = {name: match.start() for name, match in found.items() if match}
    return sorted(places, key=places.__getitem__)
