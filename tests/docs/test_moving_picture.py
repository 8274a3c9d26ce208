"""README's animation: its arrows and curves agree with the run, and its file is small."""

from pathlib import Path

import numpy as np
import pytest

import experiments
from docs.tools import drawings
from experiments.studies.simulation import study

SHOWN = Path(experiments.__file__).parents[1] / "docs" / "mechanism.gif"


def test_arrows_are_the_forces_that_carry_and_move_it():
    """Together they are the motion's wrench; the hand's arrow begins at the end of the links."""
    result, sample = study("multicontact", contact=drawings.CONTACT, noise_scale=0.0), 300
    figure, drawn = drawings.moving_figure(result)
    drawn(sample)
    arrows = [text for text in figure.axes[0].texts if hasattr(text, "xyann")]
    starts, ends = (np.array([getattr(arrow, end) for arrow in arrows]) for end in ("xyann", "xy"))
    force = (ends - starts).sum(axis=0) / drawings.METRES_PER_NEWTON
    np.testing.assert_allclose(force, result.fit("contact").predicted[sample, 1:3], rtol=1e-9)
    angles = np.cumsum([result.recording[f"joint{j}_position"][sample] for j in (1, 2)])
    links = np.array([0.425, 0.4])
    end = [-links @ np.sin(angles), links @ np.cos(angles)]
    np.testing.assert_allclose(starts, [[0, 0], end], atol=1e-9)


def test_the_one_shown_is_small_and_moves():
    image = pytest.importorskip("PIL.Image", reason="matplotlib brings Pillow")
    if not SHOWN.exists():
        pytest.skip("only a checkout has docs")
    assert SHOWN.stat().st_size < 600_000
    with image.open(SHOWN) as picture:
        assert picture.n_frames > 40
