"""Equality of recordings, for the tests."""

import numpy as np


def assert_same_recording(loaded, saved):
    """Checks that all fields are equal to the last digit, and that no streams could get lost."""
    assert not saved.streams and vars(loaded).keys() == vars(saved).keys()
    for name, value in vars(saved).items():
        other = getattr(loaded, name)
        if name == "sensors":
            value, other = ({key: vars(sensor) for key, sensor in each.items()} for each in (value, other))
        if name in ("notes", "unused"):
            value, other = list(value), list(other)
        if name in ("measured", "true"):
            assert list(value) == list(other)
        np.testing.assert_equal(other, value, err_msg=name)
