"""Choices and defaults of options, apart from the modules that use them, so that `--help` imports none of these."""

SCENE = "double_pendulum"
"""The paper's scene."""

FORMATS = ("pdf", "png", "svg")
"""File formats of figures that are byte for byte reproducible."""

REDRAWN = {
    "all": "the excitation's and the sensors' noise, every trial being a simulation",
    "sensors": "the sensors' noise around one simulation",
    "wrench": "force and torque noise alone, with exact joint states and poses",
}
"""Noise that is drawn anew for each trial."""

TRAJECTORY_TRIALS = 100
"""Largest number of trials with the trajectory estimate: enough to detect a bias of half a standard deviation."""

CRITERIA = {
    "deviations": "the smallest predicted standard deviations of the base parameters, relative to what the model knows",
    "determinant": "the largest determinant of the information, weighted by the sensors' noise",
    "condition": "the smallest condition number of the base regressor",
}
"""Criteria that a designed excitation minimizes or maximizes."""

SENSORS = ("wrench", "torque")
"""Measurements to design for: the wrench at the base, or the torques of the excited joints."""

SECONDS, VELOCITY, ACCELERATION = 10.0, 1.0, 3.0
"""Duration of an excitation in s, and its limits in rad/s and rad/s² (m/s and m/s² of slides): modest, as models do
not contain them."""

NOISE = 0.5, 0.05
"""Standard deviations of the noise on forces in N, and on moments and torques in N m, for sensors that state none."""

MARGIN = 0.02
"""Share of a joint's range that designs keep free at each stop: servos overshoot, and zeros are off by a degree."""

RANDOM_START = "a random motion within the same limits"
"""Motion that a design is compared with where there is no other."""
