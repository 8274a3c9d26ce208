"""Random measurements of random mechanisms, for the tests of the trajectory estimate."""

from dataclasses import replace

import numpy as np
from mechanisms import JOINTS, random_phi, random_pose, random_tree

from ident import Equations, Mechanism, Sensor, Sensors, find_base_parameters
from ident.estimation.equations import COMPONENTS
from ident.estimation.measurement import Measurement
from ident.estimation.recorded_motion import Tracked
from ident.estimation.setup_parameters import TRACKER, setup_parameters
from ident.mechanism.drives import Drive
from ident.model.regressor import drive_names
from ident.recordings.stated import Tracker
from ident.tolerances import DRIVE
from ident.trajectory.algebra.spline import Spline
from ident.trajectory.fit.piece import Noise, Piece, Point


def random_measurement(
    rng,
    bodies=4,
    kinds=JOINTS,
    *,
    moving=False,
    torques=True,
    wrench=True,
    contacts=1,
    setup=True,
    components=range(6),
    commanded=False,
    tracked=0,
):
    """Measurement with all kinds of channels, set-up parameters, drives and offsets that are asked for."""
    tree, gravity = random_tree(rng, bodies, kinds), 5 * rng.normal(size=3)
    springs = {name: Drive(springref=rng.normal()) for name in tree.freedoms if name in tree.joints}
    mechanism = Mechanism(tree, gravity, random_phi(rng, len(tree.inertial)), drives=springs)
    n, components = len(tree.freedoms) if torques else 0, tuple(components) if wrench else ()
    sensors = Sensors(base_wrench=wrench, joint_torques=n > 0, moving_base=moving)
    parameters = find_base_parameters(tree, gravity=gravity, sensors=sensors)
    channels = (*(COMPONENTS[k] for k in components), *(f"torque({name})" for name in tree.freedoms[:n]))
    drives = drive_names(tree, tuple(DRIVE)) if n else ()
    offsets = tuple(range(0, len(channels), 2))
    equations = Equations(
        mechanism, parameters, torques=tuple(range(n)), channels=channels, drives=drives, offsets=offsets
    )
    if commanded:
        equations = replace(equations, servos=rng.uniform(0.1, 3, size=(2, n)), scales=(0.1,) * n)
    hands = {f"hand{k}": Sensor(str(rng.choice(tree.names)), random_pose(rng)) for k in range(contacts)}
    frame = random_pose(rng) if wrench else np.eye(4)
    trackers = {f"tool{k}": Tracker(tree.names[-1]) for k in range(tracked)}
    own = setup_parameters(equations, list(hands), trackers=trackers) if setup else ()
    poses = {name: Tracked(len(tree.bodies) - 1, random_pose(rng), random_pose(rng), TRACKER) for name in trackers}
    return Measurement(equations, own, moving, frame, components, hands, poses)


def random_inputs(rng, measurement, samples=3, setup=0.05):
    """States (3, N, n) with quaternions of any length, contacts and poses (N, 2, 6 k), and θ (p,)."""
    states = rng.uniform(-1.5, 1.5, size=(3, samples, measurement.coordinates))
    wrenches = rng.normal(size=(samples, 2, 6 * (len(measurement.contacts) + len(measurement.tracked))))
    theta = rng.normal(size=len(measurement.names))
    theta[len(measurement.equations.names) :] *= setup
    return states, wrenches, theta


def at(measurement, name):
    return measurement.names.index(name)


def random_point(rng, m):
    """A piece of samples with gaps and without readings, at a random trajectory and θ, with correlated noise."""
    n, C = m.coordinates, len(m.equations.channels)
    time = np.cumsum(rng.uniform(0.02, 0.06, 45))
    time[30:] += 0.4
    when = time[0] + np.cumsum(rng.uniform(0.02, 0.05, 50))
    spline = Spline.over(time[0] - 0.2, time[-1] + 0.2, 0.2)
    c, theta = rng.normal(size=(spline.size, n)), rng.normal(size=len(m.names))
    theta[len(m.equations.names) :] *= 0.01
    noise = Noise(
        states=rng.uniform(0.005, 0.02, size=n),
        channels=rng.uniform(5, 10, size=C),
        jerk=rng.uniform(1e-3, 1e-2, size=n),
        states_rho=rng.uniform(0, 0.9, size=n),
        channels_rho=rng.uniform(0, 0.9, size=C),
        floor_states=np.zeros(n),
        floor_channels=np.zeros(C),
    )
    readings, wrenches = np.zeros((len(when), C)), rng.normal(size=(len(when), 2, 6 * len(m.contacts)))
    late = len(m.components)  # Joint torques are on the angles' clock.
    return Point(Piece(spline, time, np.zeros((len(time), n)), when, readings, wrenches, 0.3, late), c, theta, noise)
