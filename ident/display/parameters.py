"""Estimated coefficients one by one: estimate, interval, unit, body; their tables as text, HTML and data frames."""

import textwrap
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

from ident.arguments import is_number, near
from ident.display.brief import WIDTH, Worded, aligned, html_table, imported_pandas, rounded
from ident.errors import InputError
from ident.estimation.noise import coefficient_unit
from ident.geometry.inertia import body_of_parameter
from ident.mechanism.mechanism import Mechanism
from ident.regression.ordinary import Fit

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False)
class Parameter(Worded):
    """An estimated coefficient.

    Attributes:
        name: Its name, such as `m2rz2`, `Fv(knee)`, `offset(Fx)` or `scale(knee)`.
        kind: `base` for a base parameter, `drive` for friction, a rotor or a spring, `offset` of a channel, or
            `scale` of a joint's torque, true over stated.
        estimate: Its estimate in its unit.
        std: Standard deviation from the noise.
        std_setup: Standard deviation with the uncertainty of the set-up.
        unit: SI unit, "" for a scale.
        body: Body or joint that it belongs to, or the channel of an offset.
        model: The model's value; None where it has none.
        expression: The standard parameters that it consists of, its name if there is one alone.
    """

    name: str
    kind: str
    estimate: float
    std: float
    std_setup: float
    unit: str
    body: str
    model: float | None = None
    expression: str = ""

    @property
    def value(self) -> float:
        """The estimate, by its name of version 1.0."""
        return self.estimate

    def interval(self, level: float = 0.95, *, setup: bool = True) -> tuple[float, float]:
        """Confidence interval, from zero for a drive.

        Args:
            level: Confidence level, between 0 and 1.
            setup: True to include the uncertainty of the set-up.

        Raises:
            InputError: The level is not between 0 and 1.
        """
        low, high = intervals([self.estimate], [self.std_setup if setup else self.std], level)[0].tolist()
        return (max(low, 0.0) if self.kind == "drive" else low), high

    def __str__(self) -> str:
        low, high = self.interval()
        model = "" if self.model is None else f", model {self.model:.4g}"
        return f"{self.name} = {self.estimate:.4g} {self.unit}, 95 % interval {low:.4g} to {high:.4g}{model}".strip()


class Groups(dict[str, tuple[Parameter, ...]]):
    """Coefficients by the body, joint or channel that they belong to."""

    def __missing__(self, body: str) -> tuple[Parameter, ...]:
        """Raises an InputError that names what is near."""
        raise InputError(f"The estimate has no parameters of {body!r}; {near(body, self)}")


def intervals(values: Sequence[float] | np.ndarray, std: Sequence[float] | np.ndarray, level: float) -> np.ndarray:
    """Lower and upper limits of confidence intervals for normal errors (m, 2).

    Raises:
        InputError: The level is not between 0 and 1.
    """
    if not is_number(level) or not 0 < level < 1:
        raise InputError(f"level needs a number between 0 and 1, as 0.95; got {level!r}.")
    half = -special.ndtri((1 - float(level)) / 2) * np.asarray(std)
    return np.stack([np.asarray(values) - half, np.asarray(values) + half], axis=-1)


def body_of(name: str, bodies: Sequence[str]) -> str:
    """Body of a base parameter, joint of a drive, or channel of an offset, by the coefficient's name."""
    return body_of_parameter(name, bodies) or name.partition("(")[2].rpartition(")")[0]


def parameters_of(
    fit: Fit, arm: Mechanism, wider: np.ndarray, scales: Mapping[str, tuple[float, float]]
) -> tuple[Parameter, ...]:
    """All coefficients: base parameters, drives, offsets (m,), and scales of joint torques.

    Args:
        fit: The fit.
        arm: The mechanism.
        wider: Standard deviations with the uncertainty of the set-up (m,).
        scales: True over stated torque of joints, with its standard deviation, by name.
    """
    base, sums, drives = fit.parameters, fit.parameters.expressions(4), len(fit.equations.drives)
    coefficients = []
    for k, (name, value, std) in enumerate(zip(fit.names, fit.values.tolist(), fit.std.tolist(), strict=True)):
        kind = "base" if k < base.rank else "drive" if k < base.rank + drives else "offset"
        model = float(fit.equations.from_model[k]) if k < len(fit.equations.from_model) else None
        coefficients.append(
            Parameter(
                *(name, kind, value, std, float(wider[k])),
                unit=coefficient_unit(name, arm.tree),
                body=body_of(name, arm.bodies),
                # Zero for a drive means that the model states none.
                model=None if kind == "drive" and not model else model,
                expression=sums[k] if k < base.rank else name,
            )
        )
    for joint, (value, std) in scales.items():
        name = f"scale({joint})"
        coefficients.append(Parameter(name, "scale", value, std, std, "", joint, 1.0, name))
    return tuple(coefficients)


def parameters_frame(parameters: Sequence[Parameter]) -> "pd.DataFrame":
    """Data frame of parameters, indexed by their names, with 95 % intervals that include the set-up.

    Raises:
        InputError: pandas is not installed.
    """
    keys = ("name", "kind", "body", "estimate", "std", "std_setup", "lower", "upper", "unit", "model", "expression")
    limits = [dict(zip(("lower", "upper"), each.interval(), strict=True)) for each in parameters]
    rows = [vars(each) | own for each, own in zip(parameters, limits, strict=True)]
    frame = imported_pandas().DataFrame([{key: row[key] for key in keys} for row in rows], columns=keys)
    frame["model"] = frame["model"].astype(float)
    return frame.rename(columns={"name": "parameter"}).set_index("parameter")


def parameter_rows(parameters: Iterable[Parameter]) -> list[tuple[str, ...]]:
    """Cells of a table of parameters: name, body, estimate, both standard deviations, unit, model, regrouping."""
    rows: list[tuple[str, ...]] = []
    for each in parameters:
        value, std = rounded(each.estimate, each.std)
        wider = rounded(each.estimate, each.std_setup)[1]
        model = "" if each.model is None else rounded(each.model, each.std)[0]
        regrouping = "" if each.expression == each.name else each.expression
        rows.append((each.name, each.body, value, std, wider, each.unit, model, regrouping))
    return rows


HEADS = ("parameter", "of", "estimate", "s.d.", "s.d. with set-up", "unit", "model", "regrouping")
"""Headings of `parameter_rows`."""


def first_parameters(parameters: Sequence[Parameter], undetermined: Collection[str]) -> tuple[list[Parameter], str]:
    """The first 30 determined parameters of each kind, and a sentence on the others, "" for none."""
    every = [each for each in parameters if each.name not in undetermined]
    kinds = dict.fromkeys(each.kind for each in every)
    out = [row for kind in kinds for row in [each for each in every if each.kind == kind][:30]]
    left = len(parameters) - len(out)
    return out, f"… and {left} more; estimate.to_frame() has all" if left else ""


def _short(regrouping: str) -> str:
    """The regrouping, or its beginning if it has more than 40 letters."""
    return regrouping if len(regrouping) <= 40 else f"{regrouping[:38]} …"


def summary_text(headline: str, parameters: Iterable[Parameter], sentences: Iterable[str]) -> str:
    """A headline, a table of parameters, and sentences."""
    rows = [(*row[:-1], _short(row[-1])) for row in parameter_rows(parameters)]
    lines = [f"{headline}, SI units", *aligned(HEADS, rows, (2, 3, 4, 6)), *map(_wrapped, sentences)]
    return "\n".join(filter(None, lines))


def undetermined_sentence(names: Sequence[str], joints: Iterable[str]) -> str:
    """Sentence on the parameters that the motion does not determine since joints rest; empty for none."""
    if not names:
        return ""
    resting = ", ".join(sorted({*joints}))
    return (
        f"{resting} rest{'' if ',' in resting else 's'}, so that the motion does not determine "
        f"{', '.join(names)}: left out here, as near the model's values."
    )


def _wrapped(sentence: str) -> str:
    """A sentence in lines of at most `WIDTH`, further ones indented as the first."""
    indent = " " * (len(sentence) - len(sentence.lstrip()))
    return textwrap.fill(sentence, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def headline(parameters: Sequence[Parameter], samples: int, logs: int) -> str:
    """Number of parameters, and of samples and recordings that they are from."""
    others = [each for each in parameters if each.kind != "base"]
    kinds = dict.fromkeys(f"{each.kind}s" for each in others)
    more = f" and {len(others)} of {' and '.join(kinds)}" if others else ""
    recordings = f" of {logs} recordings" if logs > 1 else ""
    return f"{len(parameters) - len(others)} base parameters{more} from {samples} samples{recordings}"


def estimate_html(
    headline: str,
    verdict: str,
    parameters: Iterable[Parameter],
    sentences: Iterable[str],
    findings: Iterable[tuple[str, bool]],
    page: Path | None,
) -> str:
    """Verdict, parameters, sentences and findings, True for a doubt, with a link to a page if one was written."""
    # Units stay on one line.
    rows = [(*row[:5], row[5].replace(" ", "\N{NO-BREAK SPACE}"), *row[6:]) for row in parameter_rows(parameters)]
    items = [f"<li>{'<strong>Doubt:</strong> ' * doubt}{escape(sentence)}</li>" for sentence, doubt in findings]
    parts = [
        f"<p><strong>{escape(headline)}</strong></p>",
        f"<p>{escape(verdict)}</p>",
        html_table(HEADS, rows, (2, 3, 4, 6)),
        *(f"<p>{escape(sentence)}</p>" for sentence in sentences if sentence),
        f"<details><summary>{len(items)} findings</summary><ul>{''.join(items)}</ul></details>" if items else "",
        f'<p><a href="{escape(page.as_posix())}" target="_blank">Replay and figures</a></p>' if page else "",
    ]
    return f"<div>{''.join(parts)}</div>"
