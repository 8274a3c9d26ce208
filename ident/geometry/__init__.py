"""Poses, twists and wrenches (SE(3)), and the inertial parameters of a rigid body."""
