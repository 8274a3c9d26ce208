"""Tables of named columns: missing cells and their places."""

import numpy as np
import pytest

from ident.errors import LogError
from ident.files.table import Table


@pytest.mark.parametrize(
    ("missing", "message"),
    [
        ([3], "row 5, column 'x' is empty or NaN, as are 1 of 20 samples of it; a filter"),
        ([3, 9, 15], "row 5, column 'x' is empty or NaN, as are 3 of 20 samples of it; a filter"),
        ([3, 9, 10, 11, 15, 16], "as are 6 of 20 samples of it, 3 in a row from row 11 to row 13; a filter"),
        ([3, 9, 10, 17, 18, 19], "as are 6 of 20 samples of it, 3 in a row from row 19 to row 21; a filter"),
    ],
)
def test_the_longest_run_of_missing_samples_is_named(missing, message):
    x = np.arange(20.0)
    x[missing] = np.nan
    table = Table({"x": x}, range(2, 22), "row")
    with pytest.raises(LogError) as refusal:
        table.column("x")
    assert message in str(refusal.value)
    np.testing.assert_array_equal(table.column("x", gaps=True), x)
