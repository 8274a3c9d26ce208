"""Motors that move several joints together: rotors and friction belong to them, unless the mapping says otherwise."""

from dataclasses import replace
from functools import cache

import driven_arm
import numpy as np
import pytest
from coded import coded

import ident
from ident.errors import LogError

R = np.array([[30.0, 20.0], [30.0, -20.0]])
"""Angles of two motors over those of the joints lift and bend."""

MOTORS = ("wrist 1", "wrist 2")
TRUE = {"Ia": (1.5e-4, 1.2e-4), "Fv": (8e-4, 5e-4), "Fc": (0.03, 0.015)}
"""Rotor inertia, kg m², and friction, N m s and N m, of the motors."""

NOISE = 4e-4
"""Noise of the motors' torques, N m."""

MAPPING = {
    "motors": {
        "wrist": {
            "joints": ["lift", "bend"],
            "matrix": R.tolist(),
            "position": ["a1", "a2"],
            "torque": [{"column": "i1", "gain": 0.05, "unit": "A"}, {"column": "i2", "gain": 0.05, "unit": "A"}],
        }
    }
}


def mapping(**more):
    return {"motors": {"wrist": MAPPING["motors"]["wrist"] | more}}


@cache
def columns(seed=0):
    """Columns of a log in which lift and bend are recorded by their motors, which have rotors and friction."""
    rng = np.random.default_rng(seed)
    t, q, dq, ddq = driven_arm.motion(rng)
    first = {key: (values[0], 0, 0) for key, values in driven_arm.TRUE.items()}
    torque = driven_arm.torques(q, dq, ddq, **first)
    turns, speeds_up = dq[:, 1:] @ R.T, ddq[:, 1:] @ R.T
    Ia, Fv, Fc = map(np.array, TRUE.values())
    of_motors = torque[:, 1:] @ np.linalg.inv(R) + Ia * speeds_up + Fv * turns + Fc * np.tanh(turns / 0.05)
    of_motors += NOISE * rng.normal(size=of_motors.shape)
    turn = torque[:, 0] + driven_arm.TRUE["frictionloss"][0] * np.tanh(dq[:, 0] / 0.003)
    angles = q[:, 1:] @ R.T + 3e-3 * rng.normal(size=(len(t), 2))
    return {
        "time": t,
        "turn_position": q[:, 0] + 1e-4 * rng.normal(size=len(t)),
        "turn_torque": turn + 0.02 * rng.normal(size=len(t)),
        **dict(zip(("a1", "a2"), angles.T, strict=True)),
        **dict(zip(("i1", "i2"), of_motors.T / 0.05, strict=True)),
    }


@cache
def estimate(friction="motors"):
    arm = driven_arm.mechanism(**driven_arm.NONE)
    return ident.identify(arm, columns(), columns=mapping(friction=friction))
