"""The mathematics of geometric dynamic identification models (numpy and scipy only).

Conventions, used everywhere: SI units and radians; twists are `[v; ω]`, wrenches `[F; τ]`; `T_ab` is the pose of
frame b in frame a, so `T_ac = T_ab @ T_bc`; {0} is the base frame.
"""
