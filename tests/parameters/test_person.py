"""Priors from tables of people: the tables' sums, bodies of known lengths by hand, and required inputs."""

import numpy as np
import pytest

from ident.errors import InputError
from ident.geometry import se3
from ident.mechanism.body import BASE, Body, Follower
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.parameters.base_parameters import structural_base_parameters
from ident.parameters.person_prior import Person, Placed, with_person
from ident.parameters.prior import KNOWN, body_covariance, known_covariance

GRAVITY = np.array([0, -9.81, 0])
HINGE = np.array([0, 0, 0, 0, 0, 1.0])


def at(x, y, z=0.0):
    return se3.pose(np.eye(3), np.array([x, y, z]))


def leg(names=("pelvis", "thigh_r", "shank_r", "foot_r")):
    """Pelvis, thigh of 0.4 m, shank of 0.42 m whose frame is 0.1 m below the knee, patella and foot."""
    below_knee = np.array([0.1, 0, 0, 0, 0, 1.0])
    bodies = (
        Body(names[0], BASE, at(0, 1), HINGE, "tilt"),
        Body(names[1], 0, at(0.1, -0.1), HINGE, "hip"),
        Body("slide", 1, at(0, -0.4), np.eye(6)[0], "", True, Follower("knee", (0.0, 0.02))),
        Body(names[2], 2, at(0, -0.1), below_knee, "knee"),
        Body("patella", 1, at(0.05, -0.38), HINGE, "", False, Follower("knee", (0.0, 0.5))),
        Body(names[3], 3, at(0, -0.32), HINGE, "ankle"),
    )
    prior = np.zeros((5, 10))
    prior[:, 0] = 10, 8, 4, 0.1, 1
    prior[-1, 1:4] = 0.1, -0.05, 0
    return Mechanism(Tree(bodies), GRAVITY, prior.ravel())


def test_a_hand_is_as_long_as_its_owners_height_says_toward_the_models_own_centre():
    bodies = (Body("forearm", BASE, np.eye(4), HINGE, "elbow"), Body("hand", 0, at(0, -0.3), HINGE, "wrist"))
    prior = np.zeros((2, 10))
    prior[:, 0], prior[1, 1:4] = (1.0, 0.5), (0.03, -0.04, 0)
    arm = with_person(Mechanism(Tree(bodies), GRAVITY, prior.ravel()), Person("deleva", 70, 1.9, "male"))
    length = 0.0862 / 1.741 * 1.9
    np.testing.assert_allclose(arm.prior[11:14] / arm.prior[10], 0.79 * length * np.array([0.6, -0.8, 0]), rtol=1e-12)


@pytest.mark.parametrize(
    ("placed", "message"),
    [
        ({"pelvis": Placed("pelvis")}, "'pelvis' goes from lumbar joint to middle of the hips; say where"),
        (
            {"foot_r": Placed("foot")},
            "'foot_r' goes from ankle to metatarsal heads; say where in its frame, in m, as in",
        ),
        ({"nose": Placed("foot")}, "got nose = 'foot'"),
        ({"foot_r": Placed("nose")}, "thigh, shank, foot; got foot_r = 'nose'"),
        ({}, "No body is named as a segment"),
    ],
)
def test_what_cannot_be_known_is_asked_for(placed, message):
    with pytest.raises(InputError, match=message):
        with_person(leg(), Person("dumas", 80, 1.8, "male"), placed)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (("vitruvius", 70, 1.7, "male"), "one of winter, deleva, dumas, got 'vitruvius'"),
        (("dumas", 70, 1.7, "m"), "one of female, male, got 'm'"),
        (("dumas", 70, 175, "male"), "a height in m, got 70 and 175"),
        (("dumas", 70, float("nan"), "male"), "got 70 and nan"),
    ],
)
def test_a_person_has_a_table_a_mass_a_height_and_a_sex(given, message):
    with pytest.raises(InputError, match=message):
        Person(*given)


def test_what_is_known_of_base_parameters_has_these_widths():
    arm = with_person(leg(), Person("deleva", 70, 1.75, "male"), {"thigh_r": Placed("thigh")})
    base = structural_base_parameters(arm)
    mine = known_covariance(arm, base, KNOWN)
    without = known_covariance(Mechanism(arm.tree, GRAVITY, arm.prior), base, KNOWN)
    thigh = arm.prior[10:20]
    change = body_covariance(thigh, arm.prior_known["thigh_r"]) - body_covariance(thigh)
    B = base.regroup(np.eye(50)).T
    np.testing.assert_allclose(mine - without, B[:, 10:20] @ change @ B[:, 10:20].T, atol=1e-6)
