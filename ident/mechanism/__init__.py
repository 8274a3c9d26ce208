"""Bodies, joints and trees of them, and how their bases move."""
