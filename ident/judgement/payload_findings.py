"""Findings and verdict on a payload beyond a wrist sensor."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from scipy import special

from ident.display.brief import rounded
from ident.estimation.equations import COMPONENTS
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding, doubts_first
from ident.judgement.fit_findings import course_findings, halves_findings, model_error_findings, quality_findings
from ident.judgement.mass_findings import consistency_findings
from ident.judgement.recording_findings import clipped_findings, resolution_findings, setup_remarks, stuck_findings
from ident.judgement.residuals import BEYOND_CHANCE
from ident.judgement.verdict import Outcome, Verdict
from ident.recordings.wrench import GROUND
from ident.tolerances import INTERVAL, LIKELY, POOR, SIGNIFICANT

FORCES = COMPONENTS[:3]
"""Channels of the force."""

PLACES = ("mass", "centre x", "centre y", "centre z")
"""Mass and coordinates of the centre of mass, in the order of the parameters."""

INERTIAS = ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""Moments and products of inertia, in the order of the parameters."""

HEAVIEST = 2300.0
"""Largest possible mass of a payload, kg: what the strongest robot on the market carries. Robots carry up to what they
weigh, but some models have the last links or the gripper alone."""

JUDGES = (
    *(quality_findings, setup_remarks, course_findings, halves_findings, model_error_findings),
    *(stuck_findings, clipped_findings, resolution_findings),
)
"""Judges of the fit of a payload, in the order of their findings."""


def payload_findings(
    evidence: Evidence,
    mass: float,
    robot: float | None,
    identifiable: np.ndarray,
    sensor: str,
    least: tuple[np.ndarray, float, float] | None = None,
) -> list[Finding]:
    """Findings on a payload, the doubts first.

    Args:
        evidence: Evidence on the estimate of what the sensor carries.
        mass: Its mass, kg.
        robot: Mass of all bodies of the robot's model, kg; None without one.
        identifiable: Which of mass, centre of mass and inertias the data determine (10,).
        sensor: Name of the wrench.
        least: Axis of its smallest moment of inertia, relative standard deviation and the prior's share of that; None
            if the data determine no inertia.
    """
    on_fit = [
        *force_findings(evidence),
        *(finding for judge in JUDGES for finding in judge(evidence)),
        *(finding for finding in consistency_findings(evidence) if finding.doubt),
    ]
    if mass > min(robot or HEAVIEST, HEAVIEST):
        far = mass > min(LIKELY * (robot or HEAVIEST), HEAVIEST)
        on_fit.append(Finding.of("payload_mass_unlikely", doubt=far, mass=mass, robot=robot))
    on_fit = [_of_sensor(finding, sensor) for finding in on_fit]
    on_fit += _undetermined(identifiable)
    if least is not None and least[1] > 0.1:
        (x, y, z), std, prior = least[0].tolist(), *least[1:]
        on_fit.append(Finding.of("payload_axis_rough", x=x, y=y, z=z, std=std, prior=prior))
    return doubts_first(on_fit)


def load_findings(
    others: Sequence[Finding],
    mass: float,
    std: float,
    weighed: tuple[float, float] | None,
    robot: float,
    identifiable: np.ndarray,
    *,
    rubs: bool,
    differing: tuple[float, int],
) -> list[Finding]:
    """Findings on a load, the doubts first.

    Args:
        others: Findings on the estimates with and without it, of which doubts count.
        mass: Its mass by the recordings, whatever was stated, kg.
        std: Standard deviation of the mass, with the set-up, kg.
        weighed: Its mass by a scale with its standard deviation, kg; None if it was not stated.
        robot: Mass of the robot, kg.
        identifiable: Which of mass, centre of mass and inertias the data determine (10,).
        rubs: True if friction is another with the load.
        differing: χ² of both kinds of recordings, less what the load explains, and its degrees of freedom.
    """
    out = [*{finding.text: finding for finding in others if finding.doubt}.values()]
    if weighed is None and mass < BEYOND_CHANCE * std:
        out.append(Finding.of("load_not_shown", mass=mass, std=std))
    if weighed is not None and abs(mass - weighed[0]) > BEYOND_CHANCE * np.hypot(std, weighed[1]):
        out.append(Finding.of("load_weighs_another", mass=mass, std=std, weighed=weighed[0]))
    if mass > robot:
        out.append(Finding.of("payload_mass_unlikely", doubt=mass > LIKELY * robot, mass=mass, robot=robot))
    # A mass that is not shown is a doubt of its own.
    out += _undetermined(np.r_[True, identifiable[1:]])
    if rubs:
        out.append(Finding.of("load_changes_friction"))
    chi2, freedom = differing
    if freedom and special.chdtrc(freedom, chi2) < SIGNIFICANT:
        out.append(Finding.of("load_recordings_differ", rms_z=float(np.sqrt(chi2 / freedom))))
    return doubts_first(out)


def _undetermined(identifiable: np.ndarray) -> Iterator[Finding]:
    """Findings on quantities that are not identifiable: a doubt if the mass is not."""
    if unknown := [name for name, known in zip(PLACES, identifiable, strict=False) if not known]:
        yield Finding.of("payload_mass_unknown", doubt="mass" in unknown, quantities=unknown)
    if unknown := _unknown(identifiable):
        yield Finding.of("payload_inertia_unknown", quantities=unknown)


def force_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on forces that neither weight nor motion of a payload predict."""
    forces = {c: r for c, r in evidence.ratios.items() if c in FORCES and r > POOR and c not in evidence.idle}
    if forces:
        yield Finding.of("payload_forces_unexplained", ratios=forces)


@dataclass(frozen=True, kw_only=True, repr=False)
class PayloadVerdict(Verdict):
    """Verdict on a payload, with half-widths of its 95 % intervals.

    Attributes:
        mass: Its mass, kg.
        mass_within: Half-width of the mass, kg.
        centre_within: The largest of the centre of mass, m.
        inertia_within: The largest of the inertias, kg m²; None if they are not known.
    """

    mass: float
    mass_within: float
    centre_within: float
    inertia_within: float | None

    @classmethod
    def of_body(
        cls,
        evidence: Evidence,
        findings: Sequence[Finding],
        values: np.ndarray,
        std: np.ndarray,
        identifiable: np.ndarray,
    ) -> Self:
        """The verdict on evidence, findings and numbers.

        Args:
            evidence: Evidence on the estimate of what the sensor carries.
            findings: Findings on the payload.
            values: Mass, centre of mass and inertias (10,).
            std: Their standard deviations with the uncertainty of the set-up (10,).
            identifiable: Which of them the data determine (10,).
        """
        mass, centre, inertia = (float(INTERVAL * part.max()) for part in (std[:1], std[1:4], std[4:]))
        within: dict[str, Any] = {"mass_within": mass, "centre_within": centre}
        within |= {"inertia_within": None if _unknown(identifiable) else inertia}
        out = replace(cls.of(evidence, findings, mass=float(values[0]), **within), precision=None)
        alone = out.outcome is Outcome.USABLE and not identifiable[:4].all()
        return replace(out, outcome=Outcome.PARTLY) if alone else out

    def _part(self) -> str:
        return f"{self.brief} Turn the sensor further and faster for centre and inertias."

    def _use(self) -> Iterator[str]:
        yield f"Usable: {self._numbers}"

    @property
    def _numbers(self) -> str:
        known = self.inertia_within
        inertia = "inertias are not known" if known is None else f"inertias to {known:.1g} kg m²"
        return f"{self._mass}, the centre of mass to {1e3 * self.centre_within:.2g} mm, {inertia} (95 %)."

    @property
    def _mass(self) -> str:
        return f"{' ± '.join(rounded(self.mass, self.mass_within))} kg"

    @property
    def brief(self) -> str:
        """The load with its intervals, or why it is not to be used."""
        alone = f"Use its mass alone, {self._mass} (95 %)."
        return {Outcome.USABLE: self._numbers, Outcome.PARTLY: alone}.get(self.outcome, super().brief)


def _of_sensor(finding: Finding, sensor: str) -> Finding:
    """Finding with the sensor's name for the wrench at the base."""
    wrenches = tuple(sensor if name == GROUND else name for name in finding.place.wrenches)
    place = replace(finding.place, wrenches=wrenches)
    return replace(finding, values=_renamed(finding.values, sensor), place=place)


def _renamed(values: Any, sensor: str) -> Any:
    """Values with the sensor's name for the wrench at the base."""
    if isinstance(values, Mapping):
        return {key: _renamed(each, sensor) for key, each in values.items()}
    if isinstance(values, list | tuple):
        return [_renamed(each, sensor) for each in values]
    return sensor if isinstance(values, str) and values == GROUND else values


def _unknown(identifiable: np.ndarray) -> list[str]:
    return [name for name, known in zip(INERTIAS, identifiable[4:], strict=True) if not known]
