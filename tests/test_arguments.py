"""Invalid Python arguments raise one sentence before any computation, as mapping files do."""

from dataclasses import replace

import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

import ident
from ident.parameters.prior import body_covariance, known_covariances

RECORDING = shortened(faulty(0), 120)
DEVIATION = "needs a standard deviation, zero or false, got"
BODY = PENDULUM.bodies[0]
WRONG = [({"mass": x}, f"mass {DEVIATION} ") for x in ("a lot", -0.1, np.nan, np.inf, None, True, [0.1])]
WRONG += [({"weight": 0.1}, "has no entry 'weight'; valid are mass, center, inertia")]
WRONG += [(x, "needs standard deviations by name, out of mass, center, inertia; got") for x in ("mass", 3, ["mass"])]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        *(({"known": known}, f"^known.?{message}") for known, message in WRONG),
        ({"setup": {"late": 0.1}}, "^setup has no entry 'late'; valid are delay, lag, clock, origin"),
        *(({"setup": {"delay": x}}, f"^setup.delay {DEVIATION} ") for x in (np.nan, -1, np.inf, "long", None)),
        ({"setup": "delay"}, "^setup needs standard deviations by name"),
        ({"setup": 0}, "^setup needs standard deviations by name"),
        *(({"holdout": x}, "^holdout needs a fraction") for x in (-0.1, 1, 1.5, np.nan, "0.4", None, True)),
        ({"drive": ["coulomb", "stiction"]}, "^drive needs a list out of rotor, .*; got stiction"),
        ({"drive": "coulomb"}, "^drive needs a list out of rotor, .*; got coulomb"),
        ({"drive": 1}, "^drive needs a list"),
        ({"own": "delay"}, "^own needs a list out of offset, friction, delay, lag; got delay"),
        ({"own": None}, "^own needs a list out of offset, friction, delay, lag; got None"),
        (
            {"held_out": None},
            r"^held_out needs a Recording, the path of a log, .* or a list; got None",
        ),
        ({"held_out": ["run.csv"]}, r"^run\.csv: there is no such file"),
    ],
)
def test_arguments_are_refused_in_one_sentence(given, message):
    with pytest.raises(ident.InputError, match=message):
        ident.identify(PENDULUM, RECORDING, **given)


def test_a_recording_is_needed():
    with pytest.raises(ident.InputError, match=r"^recording needs a Recording, the path of a log, .* or a list; got 3"):
        ident.identify(PENDULUM, 3)


@pytest.mark.parametrize(
    ("given", "message"), [({"setup": {"delay": -1}}, "setup.delay"), ({"known": {"mass": np.nan}}, "known.mass")]
)
def test_what_a_recording_knows_is_checked_too(given, message):
    with pytest.raises(ident.InputError, match=f"{message} {DEVIATION}"):
        ident.identify(PENDULUM, replace(RECORDING, **given))


@pytest.mark.parametrize(("known", "message"), WRONG)
def test_how_well_bodies_are_known_is_checked(known, message):
    with pytest.raises(ident.ModelError, match=f"^prior_known of '{BODY}'.?{message}"):
        replace(PENDULUM, prior_known={BODY: known})
    for of_mechanism in (body_covariance, known_covariances):
        what = PENDULUM if of_mechanism is known_covariances else PENDULUM.known[:10]
        with pytest.raises(ident.InputError, match=f"^known.?{message}"):
            of_mechanism(what, known)


@pytest.mark.parametrize("known", ["mass", 3, None])
def test_bodies_are_known_by_their_names(known):
    with pytest.raises(ident.ModelError, match="prior_known needs standard deviations by the bodies' names"):
        replace(PENDULUM, prior_known=known)
