"""Logs without a column of times, with a rate stated in the mapping."""

import numpy as np
import pytest
from malformed_logs import PLAIN, Q
from test_column import read
from test_log import mechanism

from experiments.columns import main
from experiments.guesses.belief import toml_text
from experiments.guesses.guess import believed
from experiments.guesses.log_contents import log_contents
from ident.errors import LogError
from ident.recordings.log import read_log

UNTIMED = {name: x for name, x in PLAIN.items() if name != "time"}


def written(path, columns):
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="")
    return path


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


def test_columns_takes_a_rate_and_writes_it(tmp_path, capsys):
    path = written(tmp_path / "log.csv", UNTIMED)
    belief = believed(mechanism(), [path], rate=100.0)
    (tmp_path / "c.toml").write_text(toml_text(belief), encoding="utf-8")
    np.testing.assert_allclose(read_log(path, mechanism(), tmp_path / "c.toml").measured["hip_position"], Q[:, 1])
    assert log_contents(written(tmp_path / "timed.csv", PLAIN), rate=7.0).rate == pytest.approx(100)
    with pytest.raises(LogError, match="a log needs one, or --rate HZ"):
        log_contents(written(tmp_path / "log.csv", {"a": np.cos(np.arange(50)), "b": np.sin(np.arange(50))}))
    with pytest.raises(SystemExit):
        main(["model.xml", "log.csv", "--rate", "-3"])
    assert "needs a number of samples per second, in Hz, got '-3'" in capsys.readouterr().err
