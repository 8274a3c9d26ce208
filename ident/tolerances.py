"""Thresholds and choices that several rooms share, each with its reason; nothing is imported to know them."""

HUGE = 1e8
"""No position, velocity, acceleration, force or torque in SI units is larger."""

ZERO_COLUMN = 1e-11
"""A column below this fraction of the largest column's norm is zero but for rounding."""

SINGULAR = 1e-10
"""Singular values of unit-norm columns below this fraction of the largest carry rounding only."""

CONDITION_LIMIT = 1e4
"""Condition number of the unit-norm columns from which parameters are not separated."""

NORMAL_MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""

SIGNIFICANT = 1e-3
"""Chance of a false alarm in the tests that a verdict rests on."""

POOR, UNEXPLAINED, LEFT = 0.5, 0.9, 1.5
"""Residual over signal from which a channel is predicted poorly, from which it counts as not explained by the motion,
and from which more is wrong than that."""

TURNS = 20.0
"""Range of a hinge's angles, rad, beyond which they are suspected to be degrees."""

KILONEWTONS = 500.0
"""How many times a force falls short of the weight if it is suspected to be in kilonewtons."""

HOLDOUT = 0.4
"""Fraction of a recording, its end, that is kept to judge by."""

DRIVE = {"rotor": "Ia", "viscous": "Fv", "coulomb": "Fc", "stribeck": "Fs"}
"""What takes torque at a joint besides the links: rotor inertia times acceleration (kg m²), viscous friction times
velocity (N m s), Coulomb friction times its sign (N m), and what that is more at low velocity (Hess and Soom, J.
Tribology 112, 1990): times its sign over `1 + (q̇ / STRIBECK)²` (N m). The names are those of the columns."""

STRIBECK = 0.1
"""Velocity at which the additional friction has halved, rad/s or m/s."""
