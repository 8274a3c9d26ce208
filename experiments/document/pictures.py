"""Pictures of a page's first screen as SVG elements, which take the page's colours."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from ident.tolerances import POOR

WIDTH, LEFT, RIGHT, HEAD = 360, 76, 352, 34
"""Width of a picture, ends of its axis, and height of its legend, in pixels of the page."""

HEIGHT, HIGHEST, LOWEST = 200, 40, 6
"""Height of its rows together, and largest and smallest height of one."""

LABELLED = 10
"""Height of rows from which each has its label; of lower ones the first of so many has one."""

LONGEST = 10
"""Largest number of letters of a row's label."""

LEAST = 0.01
"""Smallest residual over signal on the axis, which ends at 1, or at 10 if there are larger ones."""

POINTS = 300
"""Largest number of points of a curve, about one for each pixel."""

SHADES = 0.1, 0.2, 0.5
"""Relative standard deviations up to which parameters have each shade, the darkest first."""


@dataclass(frozen=True)
class Interval:
    """A parameter: name, column, estimate, half-width of its interval, standard deviation, the model's value if any."""

    name: str
    column: int
    value: float
    half: float
    std: float
    model: float | None


def candidates(channels: Sequence[str], ratios: Mapping[str, np.ndarray]) -> str:
    """A row for each channel, with a mark for the residual over the signal of each candidate; the best has a ring.

    Args:
        channels: Names of the C channels.
        ratios: Residuals over signal (C,) by candidate, the estimate's first.
    """
    step, rows = _rows(channels)
    bottom = HEAD + step * len(channels)
    values = np.array([*ratios.values()])
    decades = 3 if np.nanmax(values) > 1 else 2

    def across(ratio: float) -> float:
        share = np.log10(np.clip(np.nan_to_num(ratio, nan=np.inf), LEAST, LEAST * 10**decades) / LEAST) / decades
        return LEFT + float(share) * (RIGHT - LEFT)

    poor = across(POOR)
    parts = [f'<path class="poor" d="M{poor:.1f} {HEAD}H{RIGHT}V{bottom:.1f}H{poor:.1f}z"/>']
    for tick in (LEAST * 10**k for k in range(decades + 1)):
        x = across(tick)
        parts += [_line(x, HEAD, x, bottom), _text(x, bottom + 14, f"{tick:g}", "middle")]
    for channel, y, own in zip(channels, rows, values.T, strict=True):
        words = ", ".join(f"{name} {x:.2g}" for name, x in zip(ratios, own, strict=True))
        marks = [_mark(j, across(x), y, min(4.5, step / 2)) for j, x in reversed([*enumerate(own)])]
        ring = f'<circle class="best" cx="{across(np.nanmin(own)):.1f}" cy="{y:.1f}" r="{min(7.5, step / 1.8):.1f}"/>'
        parts.append(f"<g>{_title(f'{channel}: {words}')}{_line(LEFT, y, RIGHT, y)}{''.join(marks)}{ring}</g>")
    parts.append(_text(LEFT - 16, bottom + 14, "residual", "end"))
    parts += _labels(channels, rows, step)
    legend = [(_mark(j, 0, 0, 4.5), name) for j, name in enumerate(ratios)]
    legend.append(('<circle class="best" r="6"/>', "best"))
    return _picture("Residual over signal by channel and candidate", [*_legend(legend), *parts], bottom + 20)


def parameters(bodies: Mapping[str, Sequence[Interval]], known: Sequence[int], total: int) -> str:
    """A row for each body, with a column for each kind of parameter, darker where it is better known.

    Every estimate is on the middle of its row, which reaches from zero to twice the estimate: a bar is its interval, a
    tick the model's value.

    Args:
        bodies: Parameters by body.
        known: Numbers of base parameters known within each of `SHADES`.
        total: Number of base parameters.
    """
    step, rows = _rows([*bodies])
    last = max([9, *(each.column for intervals in bodies.values() for each in intervals)])
    slot = (RIGHT - LEFT) / (last + 1)
    parts = []
    for y, intervals in zip(rows, bodies.values(), strict=True):
        bars = [_interval(each, LEFT + (each.column + 0.5) * slot, y, 0.44 * step, slot) for each in intervals]
        parts += [_line(LEFT, y, RIGHT, y), *bars]
    bottom = rows[-1] + step / 2
    kinds = {"m": (0, 0), "m r": (1, 3), "I": (4, 9)} | ({"drive": (10, last)} if last > 9 else {})
    for word, ends in kinds.items():
        x0, x1 = LEFT + ends[0] * slot, LEFT + (ends[1] + 1) * slot
        parts += [_line(x0 + 2, bottom + 4, x1 - 2, bottom + 4), _text((x0 + x1) / 2, bottom + 16, word, "middle")]
    legend = [
        (f'<rect class="known{k}" x="-6" y="-6" width="12" height="12"/>', f"±{100 * share:.0f} %: {number}")
        for k, (share, number) in enumerate(zip(SHADES, known, strict=False))
    ]
    legend.append(('<path class="tick" d="M-6 0H6"/>', "model"))
    title = f"Parameters by body with 95 % intervals; of {total} base parameters are known within 10, 20 and 50 %: "
    parts += _labels([*bodies], rows, step)
    return _picture(title + ", ".join(map(str, known)), [*_legend(legend), *parts], bottom + 22)


def _interval(each: Interval, x: float, y: float, reach: float, slot: float) -> str:
    """Bar and tick of a parameter around the middle of its row."""
    size = max(abs(each.value), 1e-300)
    half = max(reach * min(each.half / size, 1.0), 2.0)
    shade, wide = int(np.searchsorted(SHADES, each.std / size)), 0.7 * slot
    box = f'x="{x - wide / 2:.1f}" y="{y - half:.1f}" width="{wide:.1f}" height="{2 * half:.1f}"'
    bar = f'<rect class="known{shade}" {box}/>'
    if each.model is None:
        return f"<g>{_title(_words(each))}{bar}</g>"
    off = reach * float(np.clip((each.model - each.value) * np.sign(each.value or 1) / size, -1, 1))
    tick = f'<path class="tick" d="M{x - 0.45 * slot:.1f} {y - off:.1f}h{0.9 * slot:.1f}"/>'
    return f"<g>{_title(_words(each))}{bar}{tick}</g>"


def _words(each: Interval) -> str:
    model = "" if each.model is None else f", model {each.model:.3g}"
    return f"{each.name} {each.value:.3g} ± {each.half:.2g}{model}"


def curves(time: np.ndarray, panels: Mapping[str, tuple[np.ndarray, np.ndarray]]) -> str:
    """A panel for each title, with what was measured and what is predicted.

    Args:
        time: Times (N,), s.
        panels: Measured and predicted values (N,) by title; they may be NaN.
    """
    high, gap = HEIGHT / len(panels) - 22, 22
    parts = []
    for k, (title, pair) in enumerate(panels.items()):
        top = HEAD + k * (high + gap) + 8
        low, most = np.nanmin(pair), np.nanmax(pair)
        room = (most - low) or 1.0
        parts += [_line(8, y, RIGHT, y) for y in (top, top + high)]
        for style, y in zip(("measured", "predicted"), pair, strict=True):
            d = _path(8 + (RIGHT - 8) * (time - time[0]) / max(np.ptp(time), 1e-12), top + high * (most - y) / room)
            parts.append(f'<path class="{style}" d="{d}"/>')
        parts.append(_text(8, top - 5, title, "start"))
    parts.append(_text(RIGHT, HEAD + HEIGHT + 8, f"{time[-1] - time[0]:.3g} s", "end"))
    legend = [
        ('<path class="measured" d="M-8 0H8"/>', "measured"),
        ('<path class="predicted" d="M-8 0H8"/>', "predicted"),
    ]
    return _picture(
        "Measured and predicted, the worst and the best channel", [*_legend(legend), *parts], HEAD + HEIGHT + 14
    )


def _path(x: np.ndarray, y: np.ndarray) -> str:
    """Path through the smallest and the largest value of each part of a curve, interrupted where it is NaN."""
    kept = np.arange(len(y))
    if len(y) > POINTS:
        parts = np.array_split(kept, POINTS // 2)
        low = np.nan_to_num(y, nan=-np.inf)
        kept = np.unique([part[k] for part in parts for k in (low[part].argmin(), low[part].argmax())])
    points, drawing = [], False
    for i in kept:
        if np.isfinite(y[i]):
            points.append(f"{'L' if drawing else 'M'}{x[i]:.1f} {y[i]:.1f}")
        drawing = bool(np.isfinite(y[i]))
    return "".join(points)


def _mark(j: int, x: float, y: float, r: float) -> str:
    """Mark of the first candidate, a dot; of the second, a diamond; of the third, a tick."""
    if j == 0:
        return f'<circle class="mark0" cx="{x:.1f}" cy="{y:.1f}" r="{r:.1f}"/>'
    d = (
        f"m0 -{1.4 * r}l{1.4 * r} {1.4 * r}l-{1.4 * r} {1.4 * r}l-{1.4 * r} -{1.4 * r}z"
        if j == 1
        else f"m0 -{r}v{2 * r}"
    )
    return f'<path class="mark{j}" d="M{x:.1f} {y:.1f}{d}"/>'


def _rows(labels: Sequence[str]) -> tuple[float, list[float]]:
    """Height of the rows and their middles."""
    step = min(HIGHEST, max(LOWEST, HEIGHT / max(len(labels), 1)))
    return step, [HEAD + step * (k + 0.5) for k in range(len(labels))]


def _labels(names: Sequence[str], rows: Sequence[float], step: float) -> list[str]:
    """Labels of the rows, of every n-th if they are low."""
    every = max(1, int(np.ceil(LABELLED / step)))
    short = [name if len(name) <= LONGEST else f"{name[: LONGEST - 1]}…" for name in names]
    return [_text(LEFT - 6, y + 4, name, "end") for name, y in zip(short[::every], rows[::every], strict=True)]


def _legend(entries: Iterable[tuple[str, str]]) -> list[str]:
    """Marks with their words, one after the other."""
    widths = [(mark, words, 24 + 6.8 * len(words)) for mark, words in entries]
    starts = np.cumsum([10, *(width for _, _, width in widths)])
    return [
        f'<g transform="translate({start:.0f} 12)">{mark}{_text(11, 4, words, "start")}</g>'
        for start, (mark, words, _) in zip(starts, widths, strict=False)
    ]


def _line(*ends: float) -> str:
    x0, y0, x1, y1 = ends
    return f'<path class="grid" d="M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}"/>'


def _text(x: float, y: float, words: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(words)}</text>'


def _title(words: str) -> str:
    return f"<title>{escape(words)}</title>"


def _picture(title: str, parts: Iterable[str], height: float) -> str:
    head = f'<svg class="picture" viewBox="0 0 {WIDTH} {height:.0f}" role="img" aria-label="{escape(title)}">'
    return f"{head}{''.join(parts)}</svg>"
