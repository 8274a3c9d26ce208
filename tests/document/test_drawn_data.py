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


@pytest.mark.parametrize("draw", [lambda ax: ax.imshow(np.eye(2)), lambda ax: ax.fill_between([0, 1, 2], [0, 1, 0])])
def test_artists_that_cannot_be_read_are_named(draw):
    figure = Figure()
    artist = draw(figure.subplots())
    with pytest.raises(TypeError, match=f"not of {type(artist).__name__}"):
        drawn_data.csv_text(figure)
