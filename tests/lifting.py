"""A person who lifts a box of known mass in the sagittal plane: six joints, markers on skin, a delayed plate."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np

import sim
from experiments.studies.person_recordings import from_markers
from ident import Motion, Recording, base_wrench_regressor
from ident.geometry.inertia import com_from_parameters, parameters_from_com
from ident.parameters.person_prior import Person, Placed, with_person

LENGTHS = {"shank": 0.43, "thigh": 0.42, "trunk": 0.52, "upper_arm": 0.29, "forearm": 0.27, "hand": 0.1}
JOINTS = ("ankle", "knee", "hip", "shoulder", "elbow", "wrist")
PERSON = Person("winter", 75.0, 1.78, "male")
LATE, RATE, FORCE = 0.12, 50, 2.0

MODEL = """
<mujoco><worldbody><body name="foot"><geom size=".06" mass="2"/>
<body name="shank" pos="0 0 .08"><joint name="ankle" axis="0 1 0"/><geom size=".05" pos="0 0 .2" mass="6"/>
<body name="thigh" pos="0 0 .43"><joint name="knee" axis="0 1 0"/><geom size=".07" pos="0 0 .2" mass="14"/>
<body name="trunk" pos="0 0 .42"><joint name="hip" axis="0 1 0"/><geom size=".12" pos="0 0 .3" mass="40"/>
<body name="upper_arm" pos="0 0 .52"><joint name="shoulder" axis="0 1 0"/><geom size=".04" pos="0 0 -.1" mass="4"/>
<body name="forearm" pos="0 0 -.29"><joint name="elbow" axis="0 1 0"/><geom size=".03" pos="0 0 -.1" mass="2"/>
<body name="hand" pos="0 0 -.27"><joint name="wrist" axis="0 1 0"/><geom size=".02" pos="0 0 -.05" mass="1"/>
<body name="box" pos=".15 0 -.08"><geom type="box" size=".15 .2 .12" mass="9"/>
</body></body></body></body></body></body></body></body></worldbody></mujoco>
"""

UPRIGHT = np.array([0.03, -0.08, 0.08, -0.3, -1.1, 0.2])
SQUAT, STOOP = np.array([0.45, -1.3, 1.5, -0.9, -0.25, 0.1]), np.array([0.15, -0.4, 1.4, -1.3, -0.15, 0.3])


@cache
def table():
    """The lifter from a table of segments, with the box's measured mass."""
    model = sim.mechanism(mujoco.MjSpec.from_string(MODEL), base="foot")
    ends = {
        name: np.array([0, 0, -x if name in ("upper_arm", "forearm", "hand") else x]) for name, x in LENGTHS.items()
    }
    segments = {
        name: Placed("head_and_trunk" if name == "trunk" else name, np.zeros(3), end) for name, end in ends.items()
    }
    placed = with_person(model, PERSON, segments)
    twice = np.array([[1.0 if name in ("trunk", "box", "foot") else 2.0] for name in placed.bodies])
    weighed = {**placed.prior_known, "box": {"mass": 1e-3, "center": 1e-3, "inertia": 1e-2}}
    return replace(placed, prior=(twice * placed.prior.reshape(-1, 10)).ravel(), prior_known=weighed)


def lifter(seed, share=0.12):
    """A person of the same weight with segments that differ from the table."""
    rng, bodies, known = np.random.default_rng(seed), [], table()
    own = dict(zip(known.bodies, known.known.reshape(-1, 10), strict=True))
    for name, phi in own.items():
        mass, centre, central = com_from_parameters(phi)
        if name not in ("box", "foot"):
            heavier, thicker = np.exp(share * rng.normal(size=2))
            along = np.array([0.15, 0.0, 0.4]) * share * LENGTHS[name]
            mass, central = mass * heavier, central * heavier * thicker
            centre = centre + along * rng.normal(size=3)
        bodies.append(parameters_from_com(mass, centre, central))
    phi = np.array(bodies)
    hers = np.array([name not in ("box", "foot") for name in known.bodies])
    phi[hers] *= known.known[::10][hers].sum() / phi[hers, 0].sum()
    return replace(known, prior=phi.ravel(), prior_known={})


def motion(time, low, pace, seed):
    """Lifts from a low posture, with random phase shifts between joints."""
    rng = np.random.default_rng(seed)
    lag, size = 0.06 * rng.normal(size=6), 1 + 0.1 * rng.normal(size=6)
    phase = np.pi * pace * (time[:, None] - lag)
    w = 2 * np.pi * pace
    deep, rate, bend = np.sin(phase) ** 2, w / 2 * np.sin(2 * phase), w**2 / 2 * np.cos(2 * phase)
    way, more, often = size * (low - UPRIGHT), 0.06 * rng.normal(size=6), 2 * np.pi * rng.uniform(0.6, 1.1, 6)
    waves = often * time[:, None] + rng.uniform(0, 6, 6)
    q = UPRIGHT + way * deep + more * np.sin(waves)
    return Motion(q, way * rate + more * often * np.cos(waves), way * bend - more * often**2 * np.sin(waves))


def recorded(who, low, pace, seed, seconds=6.0, marker=0.002, skin=0.004):
    """A recording: angles from markers on moving skin, and forces and moment of the plate in the plane."""
    rng, time = np.random.default_rng((seed, 1)), np.arange(round(seconds * RATE)) / RATE
    late = motion(time - LATE, low, pace, seed)
    wrench = base_wrench_regressor(who.tree, *late.states, gravity=who.gravity) @ who.known
    wrench += FORCE * np.array([1, 1, 1, 0.2, 0.2, 0.2]) * rng.normal(size=wrench.shape)
    wrench[:, [1, 3, 5]] = np.nan
    felt = Recording(time, {"ground_force": wrench[:, :3], "ground_torque": wrench[:, 3:]})
    return from_markers(who, who.tree, time, motion(time, low, pace, seed), (marker, skin), rng, felt)
