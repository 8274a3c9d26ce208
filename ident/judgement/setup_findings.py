"""Findings on the set-up: gravity, times, its estimated errors, and what least squares take as exact."""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

from ident.arguments import rpy_text
from ident.judgement.evidence import Evidence
from ident.judgement.finding import FINDINGS, Finding, Place, Row
from ident.judgement.setup_errors import setup_sentence
from ident.setup import SETUP


def gravity_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on the stated direction of gravity."""
    check = evidence.checks.gravity
    if check is not None and check.suspicious:
        own: dict[str, Any] = {key: getattr(check, key) for key in ("rpy_deg", "stated", "misfit", "joint")}
        yield Finding.of("gravity_direction", moving=evidence.prepared.recording.base is not None, **own)


def delay_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on the times of channels that are late by more than the estimate includes."""
    check = evidence.checks.delay
    if check is not None and check.suspicious:
        # Checks are of the recording with the set-up of the estimate.
        delay = check.delay + sum(
            each.value for each in evidence.setup if each.kind == "delay" and check.of == "wrench"
        )
        values: dict[str, Any] = {key: getattr(check, key) for key in ("of", "std", "stated", "misfit")}
        yield Finding.of("channels_late", delay=delay, **values)


def setup_remarks(evidence: Evidence) -> Iterator[Finding]:
    """Set-up errors, and a doubt where none explains the recording."""
    for each in evidence.setup:
        yield Finding.of(each.code, each.place, **each.values)
    if evidence.trajectory is not None and evidence.trajectory.search.incredible:
        yield Finding.of("setup_unexplained", changed=bool(evidence.setup))


def exact_setup_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on a set-up that is stated as uncertain, and that least squares take as exact; on torques a doubt."""
    if evidence.trajectory is not None:
        return
    joints = tuple(evidence.fit.equations.scaled)
    kinds = tuple(dict.fromkeys(kind for log, _ in evidence.logs for kind, std in log.recording.setup.items() if std))
    if joints:
        yield Finding.of("torque_scale_taken_as_exact", Place(channels=joints), joints=joints)
    if kinds:
        yield Finding.of("setup_taken_as_exact", kinds=kinds)


def _unexplained(changed: bool) -> str:
    taken = "nothing else of it was changed" if changed else "the set-up was taken as stated"
    return (
        f"No set-up near the stated one explains the recording, whose residuals are more than noise; {taken}. Check "
        "contacts, frames, units and the model."
    )


def _gravity(rpy_deg: Sequence[float], stated: float, misfit: float, joint: str | None, moving: bool) -> str:
    rpy, option = rpy_text(rpy_deg), " ".join(f"{angle:g}" for angle in rpy_deg)
    of = "axes of the base's poses are" if moving else "base is"
    zero = "" if joint is None else f" Another zero of joint '{joint}' would look the same."
    return (
        f"Gravity has another direction than stated: the {of} turned to roll, pitch and yaw {rpy}°. With it the model "
        f"leaves {misfit:.2f} of the measurements unexplained, as stated {stated:.2f}. Write rpy_deg = {rpy} under "
        f"[base] in the columns file, or --base-rpy {option}.{zero}"
    )


def _late(of: str, delay: float, std: float, stated: float, misfit: float) -> str:
    how = "late behind" if delay > 0 else "early before"
    cure = f"Write delay = {abs(delay):.2g} under [setup] in the columns file, so that the estimate includes it"
    if of == "torques":
        cure = f"Log them in a file of their own, with constant = {-delay:.2g} for its times in the columns file"
    return (
        f"The {of} {'looks' if of == 'wrench' else 'look'} {1e3 * abs(delay):.0f} ± {1e3 * std:.0f} ms {how} the joint "
        f"angles. With that the model leaves {misfit:.2f} of the measurements unexplained, without it {stated:.2f}. "
        f"{cure}."
    )


FINDINGS.update(
    {
        f"setup_{kind}": Row(partial(setup_sentence, kind), doubt=False)
        for kind, row in SETUP.items()
        if not row.constant
    }
)
FINDINGS.update(
    gravity_direction=Row(_gravity, doubt=True),
    channels_late=Row(_late, doubt=True),
    setup_unexplained=Row(_unexplained, doubt=True),
    torque_scale_taken_as_exact=Row(
        "Least squares take the scale of the torques of {joints} as exact, though it is stated as uncertain "
        "(torque_std, kp_std). The standard deviations are without its error; --estimator trajectory estimates it.",
        doubt=True,
    ),
    setup_taken_as_exact=Row(
        "Least squares take the set-up as exact, though it is stated as uncertain ({kinds}). The standard "
        "deviations are without its errors; --estimator trajectory estimates them.",
        doubt=False,
    ),
)
