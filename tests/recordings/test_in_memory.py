"""Recordings from what is in memory: mappings of arrays, data frames, datasets."""

import re

import driven_arm
import numpy as np
import pytest
from commands import sentence_of

import ident
from ident import LogError

pytestmark = pytest.mark.extras


ARM, LOG = driven_arm.mechanism(), driven_arm.log(4.0, 50.0)
TIME, OWN = {"time": LOG.time}, dict(LOG.measured)


def same(*given):
    recording = ident.read_log(given[0], ARM, *given[1:])
    np.testing.assert_allclose(recording.time, LOG.time, atol=1e-12)
    assert recording.measured.keys() == OWN.keys()
    for name, x in OWN.items():
        np.testing.assert_array_equal(recording[name], x)


def test_a_data_frame_is_a_log_whose_index_may_be_the_time():
    pandas = pytest.importorskip("pandas", reason="pandas is in the extra 'pandas'")
    frame = pandas.DataFrame(TIME | OWN)
    dates = np.datetime64("2026-11-24T10:00") + np.round(1e9 * LOG.time).astype("timedelta64[ns]")
    same(frame)
    same(frame.set_index("time"))
    same(pandas.DataFrame(OWN, index=pandas.DatetimeIndex(dates, name="time")))
    levels = pandas.DataFrame({("arm", name): x for name, x in OWN.items()})
    for wrong, sentence in (
        (pandas.DataFrame(OWN), r".*; the pandas DataFrame has turn_position"),
        (levels, r"column \('arm', .* has a name of 2 levels and needs a text; for a data frame, frame\.columns"),
    ):
        with pytest.raises(LogError, match=f"The pandas DataFrame: {sentence}"):
            ident.read_log(wrong, ARM)
    estimate = ident.identify(ARM, frame.assign(turn_velocty=0.0), estimator="weighted", cutoff=8.0)
    assert any(note.startswith("Read the pandas DataFrame: 200 samples") for note in estimate.prepared.notes)
    assert "Column 'turn_velocty' is not used, since its name is not 'turn_velocity'" in estimate.summary()


def test_a_dataset_of_xarray_is_a_log():
    xarray = pytest.importorskip("xarray", reason="xarray is in the extra 'pandas'")
    dataset = xarray.Dataset({name: ("time", x) for name, x in OWN.items()}, coords=TIME | {"trial": 3})
    same(dataset)
    with pytest.raises(LogError, match=r"^The xarray Dataset: column 'turn_torque' needs numbers, got <U1"):
        ident.read_log(dataset.assign(turn_torque=("time", ["a"] * 200)), ARM)


def test_vectors_and_a_mapping_of_columns():
    joints, own = driven_arm.JOINTS, {"q": "position", "tau": "torque"}
    columns = {key: np.stack([OWN[f"{joint}_{kind}"] for joint in joints], axis=1) for key, kind in own.items()}
    entries = {joint: {"position": f"q.{x}", "torque": f"tau.{x}"} for joint, x in zip(joints, "xyz", strict=True)}
    same({"t": LOG.time, **columns}, {"time": "t", "joints": entries})
    untimed = {"rate": 50.0, "joints": entries, "select": {"time": [1.0, 3.0]}}
    assert ident.read_log(columns, ARM, untimed).time[[0, -1]].tolist() == [1.0, 3.0]
    with pytest.raises(LogError, match=r"The dict of columns: .*\[joints\] has no entry 'knee'"):
        ident.read_log(columns, ARM, {"joints": {"knee": {}}})


def test_bad_columns_are_one_sentence():
    for change, message in (
        ({"time": np.arange(3.0)}, "columns need one length, but 'time' has 3 samples and 'turn_position' has 200"),
        ({"turn_torque": ["a"] * 200}, "column 'turn_torque' needs numbers, got <U1"),
        ({"turn_torque": 3.0}, r"column 'turn_torque' needs a number for each sample, got shape \(\)"),
        ({"turn_position": np.full(200, np.nan)}, "turn"),
        ({"q": np.zeros((200, 3)), "q.x": np.zeros(200)}, "two columns are named 'q.x'; each needs a name of its own"),
    ):
        with pytest.raises(LogError, match=f"The dict of columns: .*{message}"):
            ident.read_log(TIME | OWN | change, ARM)


def test_what_is_no_recording_is_one_sentence():
    for call, given, sentence in (
        (ident.identify, None, "recording needs a Recording, the path of a log, a mapping of arrays, a pandas Data"),
        (ident.identify, [OWN, 3], r"recording\[1\] needs a Recording"),
        (ident.read_log, 3, r"A log needs the path of a file, or a mapping of arrays, .*; got 3\.$"),
        (ident.read_log, ["a.csv", "b.csv"], r".* got \['a.csv', 'b.csv'\]. Read each by itself, or give `identify`"),
    ):
        args = (ARM, given) if call is ident.identify else (given, ARM)
        assert re.match(sentence, sentence_of(call, *args))
