import csv
import io

import numpy as np
import pytest
from matplotlib.figure import Figure

from experiments.document import drawn_data


def rows(figure):
    """Rows of a figure's data, with numbers as numbers and NaN for empty cells."""
    out = list(csv.DictReader(io.StringIO(drawn_data.csv_text(figure))))
    for row in out:
        row |= {name: float(row[name] or "nan") for name in drawn_data.NUMBERS if name in row}
    return out


def column(shown, name, **wanted):
    """Cells of a column in the rows with these texts."""
    return [row[name] for row in shown if all(row[key] == text for key, text in wanted.items())]


def test_intervals_bars_and_spans_have_ends():
    figure = Figure()
    ax = figure.subplots()
    ax.hlines([1, 2], [0.5, -1.0], [0.75, 4.0], label="interval")
    ax.vlines(3, -1, 1, label="upright")
    ax.barh([1, 2], [3.0, 4.0], left=[-1.5, -2.0], label="predicted")
    ax.bar([7], [2.0], bottom=[1.0], label="column")
    ax.errorbar([1.0, 2.0], [3.0, 4.0], xerr=[0.5, 0.25], fmt="o", label="error")
    ax.axvspan(10, 12, label="contact")
    ax.broken_barh([(20, 1), (22, 2)], (0, 1), transform=ax.get_xaxis_transform(), label="slow")
    ax.axhline(5, label="limit")
    ax.axvline(0)
    shown = rows(figure)
    ends = {
        name: [
            [row[key] for key in ("x", "y", "x_low", "x_high", "y_low", "y_high")]
            for row in shown
            if row["curve"] == name
        ]
        for name in dict.fromkeys(row["curve"] for row in shown)
    }
    no = np.nan
    expected = {
        "limit": [[no, 5, no, no, no, no]],
        "interval": [[no, 1, 0.5, 0.75, no, no], [no, 2, -1, 4, no, no]],
        "upright": [[3, no, no, no, -1, 1]],
        "predicted": [[no, 1, -1.5, 1.5, no, no], [no, 2, -2, 2, no, no]],
        "column": [[7, no, no, no, 1, 3]],
        "error": [
            [1, 3, no, no, no, no],
            [2, 4, no, no, no, no],
            [no, 3, 0.5, 1.5, no, no],
            [no, 4, 1.75, 2.25, no, no],
        ],
        "contact": [[no, no, 10, 12, no, no]],
        "slow": [[no, no, 20, 21, no, no], [no, no, 22, 24, no, no]],
    }
    assert ends.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(ends[name], values)
    marks = {row["curve"]: row["mark"] for row in shown if row["curve"] not in ("error", "limit")}
    assert marks == {
        **dict.fromkeys(("interval", "upright"), "interval"),
        **dict.fromkeys(("predicted", "column"), "bar"),
        **dict.fromkeys(("contact", "slow"), "span"),
    }


@pytest.mark.parametrize("draw", [lambda ax: ax.imshow(np.eye(2)), lambda ax: ax.fill_between([0, 1, 2], [0, 1, 0])])
def test_artists_that_cannot_be_read_are_named(draw):
    figure = Figure()
    artist = draw(figure.subplots())
    with pytest.raises(TypeError, match=f"not of {type(artist).__name__}"):
        drawn_data.csv_text(figure)
