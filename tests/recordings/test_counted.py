"""Logs without a column of times, with a rate stated in the mapping."""

import numpy as np
import pytest
from malformed_logs import PLAIN, N, Q
from test_column import read
from test_log import mechanism

from experiments.columns import main
from experiments.guesses.guess import believed
from experiments.guesses.log_contents import log_contents
from experiments.guesses.written import toml_text
from ident.errors import LogError
from ident.recordings.log import read_log, read_log_pieces

UNTIMED = {name: x for name, x in PLAIN.items() if name != "time"}


def written(path, columns):
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="")
    return path


def test_a_rate_stands_for_times(tmp_path):
    log = read(tmp_path, UNTIMED, "rate = 250")
    np.testing.assert_allclose(log.time, np.arange(N) / 250, atol=1e-12)
    assert log.rate == pytest.approx(250) and not log.notes and not log.unused
    part = read(tmp_path, UNTIMED, "rate = 250\n[select]\ntime = [0.02, 0.1]")
    np.testing.assert_allclose(part.time, np.arange(5, 26) / 250, atol=1e-12)


def test_pieces_go_on_counting(tmp_path):
    path = written(tmp_path / "log.csv", UNTIMED)
    (tmp_path / "c.toml").write_text("rate = 0.5", encoding="utf-8")
    pieces = list(read_log_pieces(path, mechanism(), tmp_path / "c.toml", samples=11))
    assert len(pieces) > 2
    np.testing.assert_allclose(np.concatenate([piece.time for piece in pieces]), 2.0 * np.arange(N), atol=1e-9)


def test_one_of_several_files_may_have_no_times(tmp_path):
    joints, rest = ({name: x for name, x in PLAIN.items() if name.startswith("q_") == own} for own in (True, False))
    written(tmp_path / "a.csv", joints)
    written(tmp_path / "b.csv", rest)
    (tmp_path / "c.toml").write_text('time = [{ rate = 100 }, "time"]', encoding="utf-8")
    log = read_log(f"{tmp_path / 'a.csv'}+{tmp_path / 'b.csv'}", mechanism(), tmp_path / "c.toml")
    np.testing.assert_allclose(log.as_measured("hip_position").time, np.arange(N) / 100, atol=1e-12)


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
