"""Estimate of base parameters from recordings, with predictions, findings and a verdict."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np

from ident.annotations import typed
from ident.arguments import check_type, near
from ident.display.brief import decimals_of, listed, short
from ident.display.parameters import (
    Groups,
    Parameter,
    estimate_html,
    first_parameters,
    headline,
    intervals,
    parameters_frame,
    parameters_of,
    summary_text,
    undetermined_sentence,
)
from ident.errors import InputError
from ident.estimation.accumulator import accumulate
from ident.files.atomic import load_object, save_object
from ident.geometry.inertia import PARAMETERS
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding
from ident.judgement.residuals import Comparison, compared, correlation_time
from ident.judgement.verdict import Verdict, findings
from ident.mechanism.drives import NO_DRIVE, Drive
from ident.mechanism.motion import Motion
from ident.model.axes import column_place, with_values
from ident.parameters.prior import known_covariance
from ident.recordings.stated import Servo
from ident.regression.ordinary import Fit
from ident.setup import SETUP
from ident.tolerances import UNEXPLAINED
from ident.trajectory.result import TrajectoryEstimate

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

VERSION = 2
"""Version of the entries; it grows when one is renamed, removed or changes its meaning."""


@dataclass(frozen=True, eq=False, repr=False)
class Estimate(Evidence):
    """Base parameters of a mechanism from recordings.

    `estimate["m2rz2"]` is one of the parameters with its interval, `estimate.psi` all base parameters. Its length is
    their number, and iteration gives their names; `name in estimate` is true for every name that can be looked up,
    also of drives, offsets and scales. Its attributes are those of `Evidence`.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters; `fit.names` has those of drives and offsets as well (r,)."""
        return self.base.names

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All coefficients with their intervals, units and bodies: base parameters, drives, offsets, torque scales."""
        wider = np.sqrt(np.diag(self.covariance_setup))
        return parameters_of(self.fit, self.mechanism, wider, self.scales)

    def __getitem__(self, name: str) -> Parameter:
        """The coefficient of a name, such as `m2rz2` or `Fv(knee)`.

        Raises:
            InputError: There is none of that name.
        """
        if name not in self:
            raise InputError(f"The estimate has no parameter {name!r}; {near(name, self._by_name)}")
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
    def std(self) -> np.ndarray:
        """Standard deviations of the base parameters (r,)."""
        return self.fit.std[: self.base.rank]

    @property
    def std_setup(self) -> np.ndarray:
        """Standard deviations with the uncertainty of the set-up if it was estimated, else `std` (r,)."""
        return np.sqrt(np.diag(self.covariance_setup))[: self.base.rank]

    @property
    def moved_from_prior(self) -> np.ndarray:
        """Difference of ψ from the model's, in standard deviations of the prior (r,)."""
        before = known_covariance(self.mechanism, self.base, self.known, self.fit.equations.absorbed)
        return (self.psi - self.fit.equations.from_model[: self.base.rank]) / np.sqrt(np.diag(before))

    @property
    def drives(self) -> dict[str, Drive]:
        """Drives of the joints of which some are fitted, by name; other kinds have the model's values.

        Those of motors that move several joints are no joint's, and among the coefficients alone.
        """
        return self._drives_of(self.fit)

    @property
    def drives_updated(self) -> dict[str, Drive]:
        """Drives and servos of the updated model, the likeliest ones for its physical bodies, by name."""
        fit, full = self.fit.with_psi(self.psi_updated), self.consistent()
        digits = [decimals_of(std) or 0 for std in fit.std.tolist()]
        rounded = [round(x, 1 + k) + 0.0 for x, k in zip(fit.values.tolist(), digits, strict=True)]
        rotors = {name: float(f"{x:.4g}") for name, x in full.rotors.items()}
        drives = self._drives_of(replace(fit, values=np.array(rounded)), rotors)
        stated = self.mechanism.drives
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
        return with_values(self.mechanism, of_joints)

    @property
    def psi_updated(self) -> np.ndarray:
        """Base parameters of the updated model: its physical bodies, with the rotors and friction they absorb (r,)."""
        return self.consistent().psi + self.fit.equations.from_drives[: self.base.rank]

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

    @property
    def unexplained(self) -> tuple[str, ...]:
        """Channels that this motion and model do not explain."""
        return tuple(c for c, r in zip(self.channels, self.held_out.ratio, strict=True) if r > UNEXPLAINED)

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
        return self.fit.predicted(motion.checked(self.mechanism.tree))

    @typed()
    def compare(self, other: "Estimate") -> Comparison:
        """Comparison with an estimate from another recording of the same mechanism, with a test of the difference.

        Raises:
            InputError: The base parameters differ.
        """
        return compared(self.fit, other.fit)

    @property
    def displaced(self) -> dict[str, np.ndarray]:
        """Displacements of joints in their parents' frames, m (3,), by the names of the bodies that they carry."""
        tree, out = self.mechanism.tree, dict[str, np.ndarray]()
        for each in (own for own in self.setup if own.kind == "centre"):
            shift = out.setdefault(tree.names[tree.compounds[each.values["of"]][-1]], np.zeros(3))
            shift["xyz".index(each.values["axis"])] = each.value
        return out

    @cached_property
    def findings(self) -> list[Finding]:
        """Findings on the estimate, doubts first."""
        return findings(self)

    def verdict(self) -> Verdict:
        """Verdict on the estimate, with its reasons; sentences when printed."""
        return Verdict.of(self, self.findings)

    def to_dict(self) -> dict[str, Any]:
        """All results for scripts, in JSON's types."""
        verdict = self.verdict()
        fit, held, full = self.fit, self.held_out, self.consistent()
        at_rest = [_finite(x) for x in held.ratio_at_rest(held.residual).tolist()]
        keys = ("residual_rms", "signal_std", "ratio", "relative_rms", "ratio_at_rest")
        each = *(x.tolist() for x in (held.rms, held.signal, held.ratio, held.relative_rms)), at_rest
        intervals_of: dict[str, dict[str, Any]] = {name: {} for name in full.bodies}
        for row in full.rows:
            limits = {"lower": _finite(row.lower), "upper": _finite(row.upper), "share": row.share}
            intervals_of[row.body][row.quantity] = limits
        bodies = zip(self.mechanism.bodies, full.phi.reshape(-1, 10).tolist(), strict=True)
        return {
            "version": VERSION,
            **verdict.to_dict(),
            "findings": [finding.to_dict() for finding in self.findings],
            "columns": list(fit.names),
            "values": fit.values.tolist(),
            "std": fit.std.tolist(),
            "covariance": fit.covariance.tolist(),
            "regrouping": dict(zip(fit.parameters.names, fit.parameters.expressions(12), strict=True)),
            "condition_number": _finite(self.condition_number),
            "part": held.part,
            "offsets": {channel: {"value": value, "std": std} for channel, (value, std) in self.offsets.items()},
            "cutoff_hz": self.prepared.cutoff,
            "held_out": {c: dict(zip(keys, row, strict=True)) for c, *row in zip(self.channels, *each, strict=True)},
            "candidates": {name: dict(zip(self.channels, x.tolist(), strict=True)) for name, x in self.rivals.items()},
            "best_candidate": verdict.best,
            "filtered_at_hz": self.filtered_at,
            "bounded": {name: {"at_most": most, "std_free": std} for name, (most, std) in self.bounded.items()},
            "setup": [each.to_dict() for each in self.setup],
            "friction": self.friction,
            "weights": _weights(self.trajectory),
            "halves": {"rms_z": self.disagreement, "widening": self.widening, "widened": self.widened},
            "logs": {"rms_z": list(self.disagreements)},
            "intervals": intervals_of,
            "bodies": {name: dict(zip(PARAMETERS, phi, strict=True)) for name, phi in bodies},
            "std_setup": np.sqrt(np.diag(self.covariance_setup)).tolist(),
            "condition_numbers": {k: _finite(x) for k, x in self.condition_numbers.items()},
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
            "mechanism": listed(self.mechanism.bodies),
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


PAGES = WeakKeyDictionary[Estimate, Path]()
"""Pages that were written of estimates, for the links to them."""


def _finite(x: float) -> float | None:
    """The number, None for infinity and NaN, which JSON has not."""
    return x if np.isfinite(x) else None


def _weights(trajectory: TrajectoryEstimate | None) -> dict[str, Any] | None:
    """Noise model of the weights, and the errors of left-out pieces without and with each alternative."""
    if trajectory is None:
        return None
    tried = trajectory.errors
    errors = {name: dict(zip(("without", "with"), each.tolist(), strict=True)) for name, each in tried.items()}
    return {"correlated": trajectory.coloured, "left_out_errors": errors}
