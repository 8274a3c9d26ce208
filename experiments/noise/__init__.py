"""Bad motions and sensors: errors of estimators, and coverage of their intervals."""
