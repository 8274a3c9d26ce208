"""What options offer, and what they are if not given: known before anything that they choose is imported."""

SCENE = "double_pendulum"
"""The paper's scene."""

FORMATS = ("pdf", "png", "svg")
"""File formats of figures that are the same every time they are written."""

REDRAWN = {
    "all": "the excitation's and the sensors' noise, every trial being a simulation",
    "sensors": "the sensors' noise around one simulation",
    "wrench": "force and torque noise alone, with exact joint states and poses",
}
"""Which noise is drawn anew for each trial."""

JOINT_TRIALS = 100
"""Trials that the joint estimate is made of at most: enough to see a bias of half a standard deviation."""

CRITERIA = {
    "deviations": "the smallest predicted standard deviations of the base parameters, relative to what the model knows",
    "determinant": "the largest determinant of the information, weighted by the sensors' noise",
    "condition": "the smallest condition number of the base regressor",
}
"""What a designed excitation makes best."""

SENSORS = ("wrench", "torque")
"""What is measured: the wrench at the base, or the torques of the excited joints."""

SECONDS, VELOCITY, ACCELERATION = 10.0, 1.0, 3.0
"""Duration of an excitation in s, and its limits in rad/s and rad/s² (m/s and m/s² of slides): modest ones, because
models do not know them."""

NOISE = 0.5, 0.05
"""Standard deviations of the noise on forces in N, and on moments and torques in N m, where no sensor states one."""
