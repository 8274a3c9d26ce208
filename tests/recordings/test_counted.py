"""Logs without a column of times, with a rate stated in the mapping."""

import pytest
from malformed_logs import PLAIN
from test_column import read

from ident.errors import LogError

UNTIMED = {name: x for name, x in PLAIN.items() if name != "time"}


@pytest.mark.parametrize(
    "mapping, message",
    {
        "rate = 0": "rate needs a number of samples per second, in Hz; got 0",
        "rate = true": "rate needs a number of samples per second, in Hz; got True",
        "rate = nan": "in Hz; got nan",
        'rate = "fast"': "in Hz; got fast",
        'rate = 100\ntime = "time"': "has time and rate; rate is for a log without times",
        "time = { rate = -5 }": r"time\.rate needs a number of samples per second, in Hz; got -5",
        'time = { rate = 5, column = "t" }': "time has no entry 'column'; valid are rate",
        "[file]\nskip = 0": "a log needs a column of times.*, or in the mapping .* as in rate = 100; the file has",
    }.items(),
)
def test_a_rate_that_is_none_is_refused(tmp_path, mapping, message):
    with pytest.raises(LogError, match=message):
        read(tmp_path, UNTIMED, mapping)
