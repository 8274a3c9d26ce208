"""Agreement of arrays whose entries have one scale."""

import numpy as np


def close(own, expected, rtol=1e-11):
    """Checks that arrays differ by no more than a share of the largest expected number."""
    np.testing.assert_allclose(own, expected, rtol=0, atol=rtol * np.abs(expected).max(initial=0))
