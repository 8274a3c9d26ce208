"""Estimate of base parameters from recordings, with predictions, findings and a verdict."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.annotations import typed
from ident.arguments import check_type, near
from ident.display.brief import listed, short
from ident.display.html import PAGES, estimate_html
from ident.display.numbers import estimate_numbers
from ident.display.parameters import Groups, Parameter, intervals, parameters_frame, parameters_of
from ident.display.text import decimals_of, first_parameters, headline, summary_text, undetermined_sentence
from ident.errors import InputError
from ident.estimation.accumulator import accumulate
from ident.estimation.preparation import Part, Prepared
from ident.estimation.samples import Samples, joined
from ident.files.objects import load_object, save_object
from ident.judgement.agreement import Comparison, compared
from ident.judgement.candidates import ESTIMATE
from ident.judgement.checks import Checks, checked
from ident.judgement.evidence import Evidence, SetupFinding, Unmodelled, setup_findings
from ident.judgement.finding import Finding
from ident.judgement.judges import findings
from ident.judgement.residuals import correlation_time, explained_by_motion, idle_channels
from ident.judgement.torque_checks import friction_shares
from ident.judgement.verdict import Verdict
from ident.mechanism.drives import NO_DRIVE, Drive
from ident.mechanism.motion import Motion
from ident.model.axes import column_place, stated_values, with_values
from ident.parameters.base_parameters import BaseParameters
from ident.parameters.body_bounds import scaled_root
from ident.parameters.body_prior import BodyPrior, Rotors
from ident.parameters.consistency import ConsistentParameters, consistent_parameters
from ident.parameters.prior import KNOWN, known_covariance
from ident.parameters.unstated import guessed
from ident.recordings.stated import Servo
from ident.regression.held_out import HeldOut
from ident.regression.ordinary import Fit
from ident.regression.robust import spread
from ident.setup import SETUP
from ident.tolerances import CONDITION_LIMIT, UNEXPLAINED
from ident.trajectory.result import TrajectoryEstimate

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

COPIED = (
    *("fit", "condition_number", "checks", "offsets", "inseparable", "trajectory", "setup", "rivals", "filtered_at"),
    *("disagreement", "disagreements", "widening", "bounded", "friction", "covariance_setup", "unmodelled"),
)
"""Fields of the evidence that an estimate has by the same names."""

LINEARISED = 3
"""Times that a prior of masses, centres and central inertias is made linear in φ about the bodies before; the third
time no parameter of a person changes by more than .02 (kg, kg m, kg m²)."""

ROUNDING = 1e-9
"""Least eigenvalue of correlations of ψ: what the set-up adds to a covariance is definite to rounding only."""


@dataclass(frozen=True, eq=False, repr=False)
class Estimate:
    """Base parameters of a mechanism from recordings.

    `estimate["m2rz2"]` is one of the parameters with its interval, `estimate.psi` all base parameters. Its length is
    their number, and iteration gives their names; `name in estimate` is true for every name that can be looked up,
    also of drives, offsets and scales.

    Attributes:
        logs: Fitted recordings, and the fitted samples of each.
        fit: The fit.
        offsets: Constant offset of each channel where identifiable, fitted or not, with its standard deviation.
        held_out: Samples on which the fit is judged: ends of the recordings, other recordings, each recording predicted
            from the rest, or the fitted samples themselves.
        singular_values: Singular values of the unit-norm columns of base parameters and drives, each channel weighted.
        trajectory: The trajectory estimate of trajectory, parameters, set-up and noise, None for other estimators.
        filtered_at: Cut-off of the candidate `least squares`, Hz; None without it.
        filtered_values: Base parameters, drives and offsets of that candidate; None without it.
        disagreement: Root mean square z of the differences between two halves, None without two.
        disagreements: Root mean square z of each recording's parameters against the others', for three or more.
        widening: Factor on the standard deviations from the noise because of that.
        bounded: Drives at their bound of zero: upper limit of the one-sided 95 % interval, and standard deviation with
            the drive free.
        unmodelled: What the model may lack, the likeliest first.
        undetermined: Base parameters that the motion does not determine, where joints rest.
    """

    logs: Sequence[Part[slice]]
    fit: Fit
    offsets: dict[str, tuple[float, float]]
    held_out: HeldOut
    singular_values: np.ndarray
    trajectory: TrajectoryEstimate | None = None
    disagreement: float | None = None
    disagreements: tuple[float, ...] = ()
    widening: float = 1.0
    filtered_at: float | None = None
    filtered_values: np.ndarray | None = None
    bounded: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    unmodelled: Sequence[Unmodelled] = ()
    undetermined: Sequence[str] = ()

    @property
    def prepared(self) -> Prepared:
        """The first recording."""
        return self.logs[0].log

    @property
    def part(self) -> slice:
        """Fitted samples of the first recording."""
        return self.logs[0].samples

    @property
    def base(self) -> BaseParameters:
        """Regrouping of the standard parameters into base parameters."""
        return self.fit.parameters

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters; `fit.names` has those of drives and offsets as well (r,)."""
        return self.base.names

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All coefficients with their intervals, units and bodies: base parameters, drives, offsets, torque scales."""
        wider = np.sqrt(np.diag(self.covariance_setup))
        return parameters_of(self.fit, self.prepared.mechanism, wider, bounded=self.bounded, scales=self.scales)

    def __getitem__(self, name: str) -> Parameter:
        """The coefficient of a name, such as `m2rz2` or `Fv(knee)`.

        Raises:
            InputError: There is none of that name.
        """
        if name not in self:
            raise InputError(f"The estimate has no parameter {name!r}; near that are {near(name, self._by_name)}.")
        return self._by_name[name]

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name in self._by_name

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def __bool__(self) -> bool:
        return True

    @cached_property
    def _by_name(self) -> dict[str, Parameter]:
        return {each.name: each for each in self.parameters}

    @property
    def by_body(self) -> Groups:
        """Coefficients by the body, joint or channel that they belong to; a wrong name is an InputError."""
        groups = dict.fromkeys(each.body for each in self.parameters)
        return Groups({body: tuple(each for each in self.parameters if each.body == body) for body in groups})

    @typed("level")
    def interval(self, level: float = 0.95, *, setup: bool = True) -> np.ndarray:
        """Confidence intervals of the base parameters (r, 2).

        Args:
            level: Confidence level, between 0 and 1.
            setup: True to include the uncertainty of the set-up.

        Raises:
            InputError: The level is not between 0 and 1.
        """
        return intervals(self.psi, self.std_setup if setup else self.std, level)

    @property
    def psi(self) -> np.ndarray:
        """Base parameters (r,)."""
        return self.fit.psi

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the base parameters (r, r)."""
        return self.fit.covariance[: self.base.rank, : self.base.rank]

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of the base parameters (r,)."""
        return self.fit.std[: self.base.rank]

    @property
    def std_setup(self) -> np.ndarray:
        """Standard deviations with the uncertainty of the set-up if it was estimated, else `std` (r,)."""
        return np.sqrt(np.diag(self.covariance_setup))[: self.base.rank]

    @cached_property
    def covariance_setup(self) -> np.ndarray:
        """Covariance of all coefficients with the uncertainty of the set-up (m, m)."""
        if self.trajectory is None:
            return self.fit.covariance
        m = len(self.fit.names)
        added = self.trajectory.covariance_of_setup[:m, :m].copy()
        # Variances may be negative by rounding.
        np.fill_diagonal(added, np.maximum(np.diag(added), 0))
        return self.fit.covariance + added

    @property
    def moved_from_prior(self) -> np.ndarray:
        """Difference of ψ from the model's, in standard deviations of the prior (r,)."""
        mechanism = self.prepared.mechanism
        known = {**KNOWN, **self.prepared.recording.known}
        std = np.sqrt(np.diag(known_covariance(mechanism, self.base, known, self.fit.equations.absorbed)))
        return (self.psi - self.fit.equations.from_model[: self.base.rank]) / std

    @property
    def drives(self) -> dict[str, Drive]:
        """Drives of the joints of which some are fitted, by name; other kinds have the model's values.

        Those of motors that move several joints are no joint's, and among the coefficients alone.
        """
        return self._drives_of(self.fit)

    @property
    def drives_updated(self) -> dict[str, Drive]:
        """The likeliest drives beside the physical bodies, and the servos, as of the updated model, by name."""
        fit, full = self.fit.with_psi(self.psi_updated), self.consistent()
        digits = [decimals_of(std) or 0 for std in fit.std.tolist()]
        rounded = [round(x, 1 + k) + 0.0 for x, k in zip(fit.values.tolist(), digits, strict=True)]
        rotors = {name: float(f"{x:.4g}") for name, x in full.rotors.items()}
        drives = self._drives_of(replace(fit, values=np.array(rounded)), rotors)
        stated = self.prepared.mechanism.drives
        for joint, servo in self.servos.items():
            drives[joint] = drives.get(joint, stated.get(joint, NO_DRIVE)).with_servo(servo.kp, servo.kv)
        return drives

    @property
    def scales(self) -> dict[str, tuple[float, float]]:
        """True over stated torque of the joints whose scale was estimated, with its standard deviation, by name."""
        stated = {each.place.channels[0]: each for each in self.setup if SETUP[each.kind].stated}
        return {joint: (1 / (1 + own.value), own.std / (1 + own.value) ** 2) for joint, own in stated.items()}

    @property
    def servos(self) -> dict[str, Servo]:
        """Servos of the commanded joints, with the estimated scales, by name."""
        scales = {joint: scale for joint, (scale, _) in self.scales.items()}
        each = self.prepared.recording.servos.items()
        return {joint: Servo(scales.get(joint, 1) * own.kp, scales.get(joint, 1) * own.kv) for joint, own in each}

    def _drives_of(self, fit: Fit, more: Mapping[str, float] = MappingProxyType({})) -> dict[str, Drive]:
        fitted = slice(self.base.rank, self.base.rank + len(fit.equations.drives))
        equations = fit.equations
        values = dict(zip(equations.drives, fit.values[fitted].tolist(), strict=True)) | dict(more)
        of_joints = {name: x for name, x in values.items() if column_place(name)[1] not in equations.axes.motors}
        return with_values(self.prepared.mechanism, of_joints)

    @property
    def psi_of_links(self) -> np.ndarray:
        """Base parameters of the links alone, without the model's rotors and friction that they absorb (r,)."""
        return self.psi - self.fit.equations.from_drives[: self.base.rank]

    @property
    def psi_updated(self) -> np.ndarray:
        """Base parameters of the updated model: its physical bodies, with the rotors and friction they absorb (r,)."""
        return self.consistent().psi + self.fit.equations.from_drives[: self.base.rank]

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the measured channels."""
        return self.fit.equations.channels

    @property
    def inseparable(self) -> tuple[str, ...]:
        """Channels whose constant offset cannot be separated from parameters."""
        return tuple(channel for channel in self.channels if channel not in self.offsets)

    @property
    def condition_number(self) -> float:
        """Condition number of the unit-norm, weighted columns, infinite if they are dependent."""
        return _condition(self.singular_values)

    @property
    def determined_condition(self) -> float:
        """The condition number of `determined_values`."""
        return _condition(self.determined_values)

    @property
    def determined_values(self) -> np.ndarray:
        """The singular values without those of combinations that the motion does not determine, where joints rest."""
        s = self.singular_values
        return s[s > s[0] / CONDITION_LIMIT] if self.undetermined else s

    @cached_property
    def condition_numbers(self) -> dict[str, float]:
        """Condition numbers of the columns of base parameters and drives, in the ways they are published.

        `raw` in SI units, `unit_norm` with columns scaled to norm one, `weighted` with each channel divided by its
        signal as well, as `condition_number`.
        """
        columns = accumulate(self.fit.equations, self._fitted).root[:, : len(self.singular_values)]
        norms = np.linalg.norm(columns, axis=0)
        raw, unit = (float(np.linalg.cond(x)) for x in (columns, columns / np.where(norms > 0, norms, 1)))
        return {"raw": raw, "unit_norm": unit, "weighted": self.condition_number}

    @cached_property
    def _fitted(self) -> Samples:
        return joined([part.used for part in self.logs])

    @property
    def rivals(self) -> dict[str, np.ndarray]:
        """Ratios of residual to signal of other candidates on the same samples (C,), by name."""
        return {name: self.held_out.ratio_of(x) for name, x in self.held_out.rivals.items()}

    @property
    def unexplained(self) -> tuple[str, ...]:
        """Channels that this motion and model do not explain."""
        return tuple(c for c, r in zip(self.channels, self.held_out.ratio, strict=True) if r > UNEXPLAINED)

    @cached_property
    def residual(self) -> np.ndarray:
        """Measured minus predicted channels of the fitted parts (N, C)."""
        return np.concatenate([self.fit.residual(part.used) for part in self.logs])

    @cached_property
    def model_error(self) -> np.ndarray:
        """Share of each channel's residual that the motion explains beyond chance, held out and fitted (C,).

        A held-out motion is smoothed from joint angles alone, and the error of smoothing depends on the motion. In the
        fitted part the motion was estimated from the channels as well. A wrong model shows in both: the smaller share
        is returned.
        """
        held = explained_by_motion(self.held_out.residual, self.held_out.samples.motion)
        return np.minimum(held, explained_by_motion(self.residual, self._fitted.motion))

    @cached_property
    def friction(self) -> dict[str, float]:
        """Share of each joint torque's residual that friction would explain, empty without torques."""
        return friction_shares(self.fit, self._fitted) if self.fit.equations.torques else {}

    @property
    def scale(self) -> np.ndarray:
        """Robust standard deviation of each channel's residual (C,)."""
        return spread(self.residual)

    @cached_property
    def correlation(self) -> np.ndarray:
        """Correlation time of each channel's residual in the first recording, s (C,)."""
        return correlation_time(self.residual[: len(self.logs[0].times)], self.prepared.recording.rate)

    def predict(self, motion: Motion) -> np.ndarray:
        """Predicted channels for a motion, N and N m (N, C).

        Raises:
            InputError: The motion does not fit the mechanism.
        """
        needed = "a Motion(q, dq, ddq); a recording is predicted by identify(..., held_out=recording)"
        check_type("motion", motion, Motion, needed)
        return self.fit.predicted(motion.checked(self.prepared.mechanism.tree))

    @typed()
    def compare(self, other: "Estimate") -> Comparison:
        """Comparison with an estimate from another recording of the same mechanism, with a test of the difference.

        Raises:
            InputError: The base parameters differ.
        """
        return compared(self.fit, other.fit)

    @cached_property
    def _consistent(self) -> ConsistentParameters:
        arm = self.prepared.mechanism
        known = {**KNOWN, **self.prepared.recording.known}
        equations, included = self.fit.equations, self.trajectory is not None and self.trajectory.known
        stated = stated_values(arm, list(equations.absorbed))
        rotors = Rotors.of(equations.absorbed, stated, self.base.rank)
        prior, wider = guessed(arm), _regular(self.covariance_setup[: self.base.rank, : self.base.rank])

        def prior_at(phi: np.ndarray) -> BodyPrior:
            return BodyPrior.of(arm, self.base, known, rotors, used=included, at=phi)

        def fitted(at: np.ndarray) -> ConsistentParameters:
            return consistent_parameters(
                *(self.psi_of_links, self.covariance, self.base, prior),
                bodies=arm.bodies,
                masses=known["mass"],
                known=prior_at(at),
                rotors=rotors,
            )

        # Bodies have what the data say, as the total mass on a plate; their intervals allow for errors of the set-up.
        full = fitted(prior)
        for _ in range(LINEARISED if included else 0):
            full = fitted(full.phi)
        wide = replace(full.fitting, root=scaled_root(wider), prior=prior_at(full.phi if included else prior))
        full = replace(full, fitting=wide)
        # Frames stay without mass.
        return replace(full, phi=np.where(np.repeat(prior[::10] == 0, 10), 0, full.phi), model=arm.known)

    def consistent(self) -> ConsistentParameters:
        """Physical bodies as close to the mechanism's prior as the estimate allows."""
        return self._consistent

    @cached_property
    def setup(self) -> list[SetupFinding]:
        """Set-up errors, which the estimate includes."""
        return [] if self.trajectory is None else setup_findings(self.trajectory)

    @property
    def displaced(self) -> dict[str, np.ndarray]:
        """Displacements of joints in their parents' frames, m (3,), by the names of the bodies that they carry."""
        tree, out = self.prepared.mechanism.tree, dict[str, np.ndarray]()
        for each in (own for own in self.setup if own.kind == "centre"):
            shift = out.setdefault(tree.names[tree.compounds[each.values["of"]][-1]], np.zeros(3))
            shift["xyz".index(each.values["axis"])] = each.value
        return out

    @cached_property
    def evidence(self) -> Evidence:
        """Evidence that the estimate is judged by."""
        channels, held = self.channels, self.held_out
        every = {ESTIMATE: held.residual, **held.rivals}
        return Evidence(
            **{name: getattr(self, name) for name in COPIED},
            ratios=dict(zip(channels, held.ratio.tolist(), strict=True)),
            part=held.part,
            scale=dict(zip(channels, self.scale.tolist(), strict=True)),
            logs=[prepared for prepared, _ in self.logs],
            at_rest=dict(zip(channels, held.ratio_at_rest(held.residual).tolist(), strict=True)),
            in_logs=[{n: held.ratio_of(x, part) for n, x in every.items()} for part in held.left_out],
            model_error=None if self.trajectory is None else self.model_error,
            consistent=self.consistent(),
            idle=idle_channels(held, self.prepared),
        )

    @cached_property
    def findings(self) -> list[Finding]:
        """Findings on the estimate, doubts first."""
        return findings(self.evidence)

    def verdict(self) -> Verdict:
        """Verdict on the estimate, with its reasons; sentences when printed."""
        return Verdict.of(self.evidence, self.findings)

    def to_dict(self) -> dict[str, Any]:
        """All results for scripts, in JSON's types."""
        numbers = estimate_numbers(self.evidence, self.findings, self.verdict(), self.held_out, self.consistent())
        return numbers | {
            "std_setup": np.sqrt(np.diag(self.covariance_setup)).tolist(),
            "condition_numbers": {k: x if np.isfinite(x) else None for k, x in self.condition_numbers.items()},
            "scales": {joint: {"value": value, "std": std} for joint, (value, std) in self.scales.items()},
        }

    def summary(self) -> str:
        """Parameters, prediction errors, verdict and findings as text; `print(estimate)` is short."""
        parameters, more = first_parameters(self.parameters, self.undetermined)
        sentences = [
            more,
            f"Residual over signal: {self._ratios}; condition number {self.determined_condition:.3g}.",
            self.undetermined_sentence,
            str(self.verdict()),
            *(f"  {note}" for part in self.logs for note in part.log.notes),
            *(finding.line for finding in self.findings),
        ]
        return summary_text(self._headline, parameters, sentences)

    @property
    def undetermined_sentence(self) -> str:
        """Sentence on the parameters that the motion does not determine since joints rest; empty for none."""
        return undetermined_sentence(self.undetermined, (joint for part in self.logs for joint in part.log.resting))

    @property
    def _headline(self) -> str:
        return headline(self.parameters, self.fit.samples, len(self.logs))

    @property
    def _ratios(self) -> str:
        return ", ".join(f"{c} {r:.2f}" for c, r in zip(self.channels, self.held_out.ratio, strict=True))

    def __repr__(self) -> str:
        doubts = sum(finding.doubt for finding in self.findings)
        counts = {"doubt": doubts, "remark": len(self.findings) - doubts}
        numbers = [f"{count} {word}{'s' * (count != 1)}" for word, count in counts.items()]
        lines = {
            "mechanism": listed(self.prepared.mechanism.bodies),
            "residual over signal": self._ratios,
            "verdict": f"{self.verdict().outcome.value}, {', '.join(numbers)}",
            "more": "print(estimate.summary()), estimate.to_frame(), estimate.plot()",
        }
        return short(f"Estimate of {self._headline}", lines)

    def _repr_html_(self) -> str:
        parameters, more = first_parameters(self.parameters, self.undetermined)
        sentences = [more, f"Residual over signal: {self._ratios}"]
        findings = ((each.text, each.doubt) for each in self.findings)
        return estimate_html(self._headline, str(self.verdict()), parameters, sentences, findings, PAGES.get(self))

    def to_frame(self) -> "pd.DataFrame":
        """All coefficients as a pandas data frame, with 95 % intervals that include the set-up.

        Raises:
            InputError: pandas is not installed (extra `pandas`).
        """
        return parameters_frame(self.parameters)

    def plot(self) -> "Figure":
        """Base parameters with 95 % intervals beside the model's, as a matplotlib figure."""
        from ident.display.plots import NOTEBOOK, parameters_figure

        half = np.diff(self.interval(), axis=1)[:, 0] / 2
        model = self.fit.equations.from_model[: len(self)]
        return parameters_figure(NOTEBOOK, self.names, self.psi, half, model)

    def plot_fit(self) -> "Figure":
        """Measured and predicted channels on the held-out part, as a matplotlib figure."""
        from ident.display.plots import NOTEBOOK, channel_labels, fit_figure

        held = self.held_out
        slow = held.interrupted(~held.moving, by=False)
        return fit_figure(NOTEBOOK, channel_labels(self.fit.equations), held.curves, slow)

    def plot_spectra(self) -> "Figure":
        """Spectra of the channels and of their residuals, as a matplotlib figure."""
        from ident.display.plots import NOTEBOOK, channel_labels, spectra_figure

        held, labels = self.held_out, channel_labels(self.fit.equations, "/√Hz")
        return spectra_figure(NOTEBOOK, labels, self.prepared.recording.rate, (held.samples.measured, held.residual))

    def save(self, path: str | Path) -> None:
        """Writes a `.npz` file that `load` reads back, in the same version; the model's file is not part of it.

        Raises:
            InputError: The folder does not exist.
        """
        save_object(path, "estimate", self)

    @classmethod
    def load(cls, path: str | Path) -> "Estimate":
        """Reads what `save` wrote.

        Its mechanism has no source: to update a model, give `sim.write_model` the mechanism from the model's file.

        Raises:
            InputError: The file is missing, is no saved estimate, or was written by another version.
        """
        loaded: Estimate = load_object(path, "estimate", cls)
        return loaded

    @cached_property
    def checks(self) -> Checks:
        """Checks of recording, set-up and fit."""
        return checked(self.prepared, self.fit, self.part)


def _regular(covariance: np.ndarray) -> np.ndarray:
    """A covariance whose correlations have eigenvalues from `ROUNDING` on."""
    std = np.sqrt(np.diag(covariance))
    values, axes = np.linalg.eigh(covariance / np.outer(std, std))
    return np.asarray((axes * np.maximum(values, ROUNDING)) @ axes.T * np.outer(std, std))


def _condition(singular_values: np.ndarray) -> float:
    """Ratio of the largest to the smallest of sorted singular values, infinite if that is zero."""
    largest, smallest = singular_values[[0, -1]].tolist()
    return largest / smallest if smallest else np.inf
