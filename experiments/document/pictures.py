"""Pictures of a page's first screen: what the template `pictures.html` draws, as SVG elements in the page's colours."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.document.writer import environment
from ident.judgement.fit_findings import about_best
from ident.judgement.verdict import PRECISIONS
from ident.tolerances import POOR

LEAST = -6, -2
"""Least and largest power of ten at which the axis of residuals over the signals begins; it ends at 1, or at 10 if some
are larger."""


@dataclass(frozen=True)
class Interval:
    """A parameter: name, column, estimate, half-width of its interval, standard deviation, the model's value if any."""

    name: str
    column: int
    value: float
    half: float
    std: float
    model: float | None

    def to_page(self) -> dict[str, Any]:
        """Its half-width and the model's value as shares of the estimate, around it, and its shade."""
        size = max(abs(self.value), 1e-300)
        off = None if self.model is None else np.sign(self.value or 1) * (self.model - self.value) / size
        known = "" if self.model is None else f", model {self.model:.3g}"
        return {
            "words": f"{self.name} {self.value:.3g} ± {self.half:.2g}{known}",
            "column": self.column,
            "half": min(self.half / size, 1.0),
            "shade": int(np.searchsorted(PRECISIONS, self.std / size)),
            "model": None if off is None else float(np.clip(off, -1, 1)),
        }


def candidates(channels: Sequence[str], ratios: Mapping[str, np.ndarray], idle: Collection[str] = ()) -> str:
    """A row for each channel, with a mark for the residual over the signal of each candidate; the best have rings.

    Args:
        channels: Names of the C channels.
        ratios: Residuals over signal (C,) by candidate, the estimate's first.
        idle: Channels that do not count, which are pale.
    """
    values = np.array([*ratios.values()])
    # The smallest mark keeps off the labels.
    smallest = np.where(values > 0, values, 1).min() / 1.5
    first, last = int(np.clip(np.floor(np.log10(smallest)), *LEAST)), int(np.nanmax(values) > 1)
    powers = range(first, last + 1)

    def share(ratio: float) -> float:
        """Place of a ratio between the ends of the axis, of one that is not known at the upper end."""
        power = np.log10(max(ratio, 10.0**first)) if ratio <= 10.0**last else last
        return float((power - first) / (last - first))

    shown = []
    for name, own, best in zip(channels, values.T, about_best(values).T, strict=True):
        words = ", ".join(f"{each} {x:.2g}" for each, x in zip(ratios, own, strict=True))
        marks = [(j, share(own[j])) for j in reversed(range(len(own)))]
        own_words = {"name": name, "words": f"{name}: {words}", "idle": name in idle}
        shown.append(own_words | {"marks": marks, "best": [share(ratio) for ratio in own[best & (len(own) > 1)]]})
    ticks = [(f"{10.0**power:g}", share(10.0**power)) for power in powers]
    minor = [share(10.0**power * k) for power in powers[:-1] for k in range(2, 10)]
    return _drawn("candidates", shown, [*ratios], ticks, minor, share(POOR), *_rows(channels))


def parameters(bodies: Mapping[str, Sequence[Interval]], known: Sequence[int], total: int) -> str:
    """A row for each body, with a column for each kind of parameter, darker where it is better known.

    Every estimate is on the middle of its row, which reaches from zero to twice the estimate: a bar is its interval, a
    tick the model's value.

    Args:
        bodies: Parameters by body.
        known: Numbers of base parameters known within each of `PRECISIONS`.
        total: Number of base parameters.
    """
    shown = {name: [each.to_page() for each in own] for name, own in bodies.items()}
    every = sorted((each.column, each.name.partition("(")[0]) for own in bodies.values() for each in own)
    kinds = {k: name for k, name in enumerate(["", *"xyz", "xx", "yy", "zz", "xy", "xz", "yz"])}
    kinds |= {column: name for column, name in every if column not in kinds}
    return _drawn("parameters", shown, [*known], total, [*kinds.values()], *_rows([*bodies]))


def coverage(errors: Mapping[str, np.ndarray], what: str) -> str:
    """A row for each name, with a dot for each parameter: `what`, an error or difference, over half of its interval."""
    # Dots from twice that on are at the end of the axis.
    shown, beyond = {}, 2
    for name, own in errors.items():
        # From the middle on by the golden ratio, which spreads any number of dots.
        apart = (0.5 + 0.618 * np.arange(len(own))) % 1 - 0.5
        held = f"{(abs(own) <= 1).sum()} of {len(own)}"
        shown[name] = {"held": held, "dots": [*zip(np.clip(own, -beyond, beyond), apart, strict=True)]}
    return _drawn("coverage", shown, beyond, what)


def curves(time: np.ndarray, panels: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> str:
    """A panel for each title, with what was measured and what is predicted.

    Args:
        time: Times (N,), s; NaN where curves are interrupted.
        panels: Measured and predicted values (N,) by title.
    """
    start, end = np.nanmin(time), np.nanmax(time)
    # Pixels.
    wide, high = 300, 78
    x, shown = wide * (time - start) / max(end - start, 1e-12), {}
    for title, pair in panels.items():
        low, top = np.nanmin(pair), np.nanmax(pair)
        ends = [f"{end:.3g}".replace("-", "\N{MINUS SIGN}") for end in (top, low)]
        shown[title] = [_path(x, high * (top - y) / ((top - low) or 1.0), wide) for y in pair], ends
    return _drawn("curves", shown, f"{end - start:.3g} s")


def _path(x: np.ndarray, y: np.ndarray, points: int) -> str:
    """Path through the smallest and the largest value of each part of a curve, interrupted where it is NaN.

    It has at most so many points, about one for each pixel.
    """
    kept = np.arange(len(y))
    if len(y) > points:
        low = np.nan_to_num(y, nan=-np.inf)
        parts = np.array_split(kept, points // 2)
        kept = np.unique([part[k] for part in parts for k in (low[part].argmin(), low[part].argmax())])
    there = np.isfinite(x[kept] + y[kept])
    begins = there & ~np.append(False, there[:-1])
    return "".join(f"{'M' if begins[k] else 'L'}{x[i]:.1f} {y[i]:.1f}" for k, i in enumerate(kept) if there[k])


def _rows(names: Sequence[str]) -> tuple[list[float], float, list[str]]:
    """Middles of rows below a legend, their height, and their labels; of several low rows only one has its label.

    Rows take 240 pixels together, each 6 to 33, and 12 for its label.
    """
    head, step = 34, min(33, max(6, 240 / max(len(names), 1)))
    every = max(1, int(np.ceil(12 / step)))
    labels = [label if k % every == 0 else "" for k, label in enumerate(labels_of(names))]
    return [head + step * (k + 0.5) for k in range(len(names))] or [head], step, labels


def labels_of(names: Sequence[str]) -> list[str]:
    """Names in words, without a last one that all share, and those of more than 15 letters without their middle.

    >>> labels_of(["shoulder_pan_joint", "shoulder_lift_joint", "a_joint_of_many_words_joint"])
    ['shoulder pan', 'shoulder lift', 'a joint…y words']
    """
    words = [name.replace("_", " ").split(" ") for name in names]
    shared = len(names) > 1 and all(len(each) > 1 for each in words) and len({each[-1] for each in words}) == 1
    texts = [" ".join(each[:-1] if shared else each) for each in words]
    return [text if len(text) <= 15 else f"{text[:7]}…{text[-7:]}" for text in texts]


def _drawn(kind: str, *given: Any) -> str:
    return str(getattr(environment().get_template("pictures.html").module, kind)(*given))
