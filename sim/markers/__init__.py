"""Motion capture: joint angles, their covariance and segment lengths from the positions of markers."""
