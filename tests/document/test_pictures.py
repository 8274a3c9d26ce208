"""Pictures of the first screen show the numbers that they are given."""

import re

import numpy as np
import pytest

from experiments.document import pictures
from experiments.document.pictures import Interval


def places(picture, shape, attribute):
    """Values of an attribute of the shapes of a class."""
    found = re.findall(rf'<\w+ class="{shape}"[^>]*? {attribute}="([^"]*)"', picture)
    return [float(each) for each in found]


@pytest.mark.parametrize(("most", "ticks"), [(0.9, ["0.01", "0.1", "1"]), (2.0, ["0.01", "0.1", "1", "10"])])
def test_a_ring_is_around_the_best_candidate_of_each_channel(most, ticks):
    ratios = {
        "estimate": np.array([0.1, 0.2]),
        "least squares": np.array([0.05, np.nan]),
        "model": np.array([most, 0.3]),
    }
    drawn = pictures.candidates(["Fx", "Fy"], ratios)
    dots, rings = (places(drawn, shape, "cx") for shape in ("mark0", "best"))
    decades = len(ticks) - 1
    at = [100 + 252 * np.log10(ratio / 0.01) / decades for ratio in (0.1, 0.2)]
    np.testing.assert_allclose(dots[1:], at, atol=0.06)
    np.testing.assert_allclose(rings, [100 + 252 * np.log10(5) / decades, at[1]], atol=0.06)
    assert "<title>Fx: estimate 0.1, least squares 0.05," in drawn and all(f">{tick}<" in drawn for tick in ticks)


def test_candidates_that_are_about_as_good_as_the_best_have_rings_too():
    ratios = {"estimate": [0.1005, 0.015], "least squares": [0.1, 0.012], "model": [0.12, 0.5]}
    drawn = pictures.candidates(["Fx", "Fy"], {name: np.array(own) for name, own in ratios.items()})
    at = [100 + 252 * np.log10(ratio / 0.01) / 2 for ratio in (0.1005, 0.1, 0.015, 0.012)]
    np.testing.assert_allclose(places(drawn, "best", "cx"), at, atol=0.06)


def test_parameters_are_darker_where_they_are_better_known_and_the_models_value_is_beside_them():
    known = [Interval("m1", 0, 2.0, 0.2, std, 2.5) for std in (0.1, 0.4, 1.0, 2.0)]
    drawn = pictures.parameters({"arm": [*known, Interval("Fc(a)", 10, -1.0, 9.0, 9.0, None)]}, (1, 2, 3), 4)
    assert re.findall(r'class="known(\d)" x="[^-]', drawn) == ["0", "1", "2", "3", "3"]
    heights = places(drawn, r"known\d", "height")[3:]
    np.testing.assert_allclose(heights, [4.0, 4.0, 4.0, 4.0, 2 * 0.44 * 40], atol=0.06)
    # A quarter more than the estimate is a quarter of half a row above it.
    ticks = [float(y) for y in re.findall(r'class="tick" d="M[\d.]+ ([\d.]+)h', drawn)]
    np.testing.assert_allclose(ticks, [54 - 0.44 * 40 / 4] * 4, atol=0.06)
    assert "m1 2 ± 0.2, model 2.5" in drawn and ">20 %: 2<" in drawn and ">drive<" in drawn


def test_curves_keep_their_extremes_and_their_gaps():
    time = np.arange(5000.0)
    y = np.sin(time / 100)
    y[777], time[1000:1100] = 5.0, np.nan
    drawn = pictures.curves(time, {"worst: Fx": (y, np.zeros(5000))})
    measured = re.findall(r'class="measured" d="(M[^"-]*)"', drawn)[0]
    points = np.array([each.split() for each in re.split("[ML]", measured)[1:]], float)
    assert measured.count("M") == 2 and len(points) <= pictures.POINTS and "nan" not in drawn
    assert points[:, 1].min() == 0 and abs(points[points[:, 1].argmin(), 0] - 344 * 777 / 4999) < 0.1


def test_many_rows_are_low_and_some_have_labels():
    names = [f"joint_with_a_long_name_{k}" for k in range(60)]
    drawn = pictures.candidates(names, {"estimate": np.full(60, 0.1)})
    assert drawn.count('text-anchor="end"') == 30 and len(re.findall(r">joint w…\w* ?\w* \d+<", drawn)) == 30
    height = int(re.search(r'viewBox="0 0 360 (\d+)"', drawn)[1])
    assert height == 34 + 60 * pictures.LOWEST + 34


def test_labels_of_names_that_begin_or_end_alike_differ():
    """A shoulder's two joints were one label, as both were cut after ten letters."""
    assert pictures.labels_of(["shoulder_pan_joint", "shoulder_lift_joint"]) == ["shoulder pan", "shoulder lift"]
    assert pictures.labels_of(["left_upper_forearm", "left_lower_forearm"]) == ["left upper", "left lower"]
    labels = pictures.labels_of(["right_upper_arm_roll", "right_upper_arm_pitch"])
    assert len(set(labels)) == 2 and max(map(len, labels)) <= pictures.LETTERS + 1
    assert pictures.labels_of(["knee_joint"]) == ["knee joint"] and pictures.labels_of(["Fx", "Fy"]) == ["Fx", "Fy"]
