"""Bodies, joints, trees of bodies, and the motion of joints and bases."""
