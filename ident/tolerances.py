"""Thresholds and defaults shared by several packages, each with its reason; this module imports nothing."""

HUGE = 1e8
"""Upper limit of every position, velocity, acceleration, force and torque in SI units."""

TINY = 1e-100
"""Size of a measured number below which it is zero: squares of squares stay numbers, and no sensor reads so little."""

ROUNDING = 1e-9
"""Difference of numbers, relative to their size, up to which they are equal: of the sixteen digits of a double, files,
conversions and sums of thousands leave nine."""

FAR_BETTER = 0.5
"""Error of one explanation over that of another, for loads their squares, below which it is far better. On simulated
arms of seven joints the square is below 0.1 with loads, and from 0.9 up with factors of units and gears."""

AGREES = 0.8
"""Share of a column's variance from which a prediction is one of that column."""

NOTABLY = 1.1
"""Ratio of two errors from which the smaller one is better."""

CLEARLY = 1.25
"""Ratio of two errors from which the smaller one is clearly better: of a hundred independent samples, more than which
few held-out parts have, the root mean square is known to 7 % and the ratio of two to 10 %."""

AT_ONCE = 2_000_000
"""Numbers of intermediate arrays that are in memory at the same time; more would not stay in the cache."""

ZERO_COLUMN = 1e-11
"""Norm of a column, relative to the largest, below which it is zero up to rounding."""

SINGULAR = 1e-10
"""Singular value of unit-norm columns, relative to the largest, below which it is only rounding."""

CONDITION_LIMIT = 1e4
"""Condition number of the unit-norm columns above which parameters are not separated."""

NORMAL_MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""

LEAST_SAMPLES = 10
"""Fewest samples that a log needs, and fewest poses from which an axis is recovered."""

SIGNIFICANT = 1e-3
"""Significance level of the tests behind a verdict."""

POOR, UNEXPLAINED, LEFT = 0.5, 0.9, 1.5
"""Residual over signal above which a channel is predicted poorly, above which the motion does not explain it, and above
which there must be a grosser error."""

TURNS = 20.0
"""Range of a hinge's angles, rad, above which they are suspected to be in degrees."""

KILONEWTONS = 500.0
"""Ratio of the weight to a force above which the force is suspected to be in kilonewtons."""

HOLDOUT = 0.4
"""Fraction of a recording, its end, that is held out."""

DRIVE = {"rotor": "Ia", "viscous": "Fv", "coulomb": "Fc", "stribeck": "Fs", "spring": "K"}
"""Column names of the drives' torques: rotor inertia (kg m²) times acceleration, viscous friction (N m s) times
velocity, Coulomb friction (N m) times the sign of velocity, Stribeck friction (N m), additional at low velocity,
times the sign over `1 + (q̇ / STRIBECK)²` (Hess and Soom, J. Tribology 112, 1990), and stiffness (N m/rad) times the
coordinate less the model's spring reference."""

DRIVE_UNITS = {
    "Ia": ("kg m²", "kg"),
    "Fv": ("N m s", "N s/m"),
    "Fc": ("N m", "N"),
    "Fs": ("N m", "N"),
    "K": ("N m/rad", "N/m"),
}
"""Units of drives by their columns, of joints that turn and of those that slide."""

USUAL_DRIVE = ("rotor", "viscous", "coulomb")
"""Kinds that every driven joint has: fitted by default where its torque is measured."""

STRIBECK = 0.1
"""Velocity at which the Stribeck friction has halved, rad/s or m/s."""

NAMED = 4
"""Largest number of parameters, bodies or other things that a sentence names; more are counted."""

INTERVAL = 1.959964
"""Half-width of a 95 % interval, standard deviations."""

LIKELY = 10.0
"""Factor between a mass and the model's above which another error is likelier than such a mass."""
