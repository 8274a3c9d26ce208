"""Pictures of the first screen show the numbers that they are given."""

import re

import numpy as np
import pytest

from experiments.document import pictures


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


def test_labels_of_names_that_begin_or_end_alike_differ():
    """A shoulder's two joints were one label, as both were cut after ten letters."""
    assert pictures.labels_of(["shoulder_pan_joint", "shoulder_lift_joint"]) == ["shoulder pan", "shoulder lift"]
    assert pictures.labels_of(["left_upper_forearm", "left_lower_forearm"]) == ["left upper", "left lower"]
    labels = pictures.labels_of(["right_upper_arm_roll", "right_upper_arm_pitch"])
    assert len(set(labels)) == 2 and max(map(len, labels)) <= pictures.LETTERS + 1
    assert pictures.labels_of(["knee_joint"]) == ["knee joint"] and pictures.labels_of(["Fx", "Fy"]) == ["Fx", "Fy"]


def test_one_candidate_has_no_ring_and_axes_have_minor_ticks():
    drawn = pictures.candidates(["Fx"], {"estimate": np.array([0.1])})
    assert ">best<" not in drawn and not places(drawn, "best", "cx") and drawn.count("v-4") == 16


def test_columns_of_parameters_and_ends_of_curves_have_their_numbers():
    each = [pictures.Interval(name, k, 1.0, 0.1, 0.05, None) for k, name in ((0, "m1"), (4, "Ixx1"), (10, "Fc(a)"))]
    drawn = pictures.parameters({"arm": each}, (1, 2, 3), 3)
    assert re.findall(r'<text class="small"[^>]*>([^<]*)<', drawn)[4:] == ["xx", "yy", "zz", "xy", "xz", "yz", "Fc"]
    drawn = pictures.curves(np.arange(3.0), {"worst": (np.array([0.0, 111.2, 1.0]), np.array([0.0, -49.4, 1.0]))})
    assert re.findall(r'<text class="small"[^>]*>([^<]*)<', drawn) == ["111", "\N{MINUS SIGN}49.4"]
