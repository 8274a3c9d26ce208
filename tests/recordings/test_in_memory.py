"""Recordings from what is in memory: mappings of arrays, data frames, datasets."""

import re

import driven_arm
import numpy as np
import pytest

import ident
from ident.errors import InputError, LogError

pytestmark = pytest.mark.extras


def columns():
    """Columns of the arm's recording, with names that the arm has."""
    log = driven_arm.log(4.0, 50.0)
    return {"time": log.time, **log.measured}


class Frame:
    """As much of a data frame as is needed; it is its own index."""

    def __init__(self, columns, index, name):
        self.columns, self.index, self.name = list(columns), self, name
        self._columns, self._index = columns, index

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self._index)

    def __getitem__(self, name):
        return self._columns[name]


def same(recording):
    log = driven_arm.log(4.0, 50.0)
    np.testing.assert_allclose(recording.time, log.time, atol=1e-12)
    assert recording.measured.keys() == log.measured.keys()
    for name, x in log.measured.items():
        np.testing.assert_array_equal(recording[name], x)


@pytest.mark.parametrize("dates", [False, True])
def test_a_data_frame_is_a_log_whose_index_may_be_the_time(dates):
    own = columns()
    time = own.pop("time")
    if dates:
        time = np.datetime64("2026-11-24T10:00") + np.round(1e9 * time).astype("timedelta64[ns]")
    same(ident.read_log(Frame(own, time, "time"), driven_arm.mechanism()))
    with pytest.raises(LogError, match=r"The \S+ Frame: .*; the \S+ Frame has turn_position"):
        ident.read_log(Frame(own, time, None), driven_arm.mechanism())


def test_a_real_data_frame_is_a_log():
    pandas = pytest.importorskip("pandas")
    same(ident.read_log(pandas.DataFrame(columns()), driven_arm.mechanism()))
    same(ident.read_log(pandas.DataFrame(columns()).set_index("time"), driven_arm.mechanism()))
    frame = pandas.DataFrame(columns())
    levels = frame.set_axis(pandas.MultiIndex.from_tuples([("arm", name) for name in frame]), axis=1)
    for wrong, sentence in {
        "column ('arm', 'time') has a name of 2 levels and needs a text; for a data frame, frame.columns": levels,
        "two columns are named 'time'; each needs a name of its own.": frame.rename(columns={"turn_torque": "time"}),
    }.items():
        with pytest.raises(LogError, match=re.escape(f"The pandas DataFrame: {wrong}")):
            ident.read_log(sentence, driven_arm.mechanism())
    misspelt = frame.assign(turn_velocty=0.0)
    estimate = ident.identify(driven_arm.mechanism(), misspelt, estimator="weighted", cutoff=8.0)
    assert any(note.startswith("Read the pandas DataFrame: 200 samples") for note in estimate.prepared.notes)
    assert "Column 'turn_velocty' is not used, since its name is not 'turn_velocity'" in estimate.summary()


def test_a_dataset_of_xarray_is_a_log():
    xarray = pytest.importorskip("xarray")
    own = columns()
    time = own.pop("time")
    dataset = xarray.Dataset({name: ("time", x) for name, x in own.items()}, coords={"time": time, "trial": 3})
    same(ident.read_log(dataset, driven_arm.mechanism()))
    with pytest.raises(LogError, match=r"^The xarray Dataset: column 'turn_torque' needs numbers, got <U1"):
        ident.read_log(dataset.assign(turn_torque=("time", ["a"] * 200)), driven_arm.mechanism())


def test_vectors_and_a_mapping_of_columns():
    own = columns()
    joints = driven_arm.JOINTS
    stacked = {"t": own["time"], "q": np.stack([own[f"{joint}_position"] for joint in joints], axis=1)}
    stacked["tau"] = np.stack([own[f"{joint}_torque"] for joint in joints], axis=1)
    entries = {joint: {"position": f"q.{x}", "torque": f"tau.{x}"} for joint, x in zip(joints, "xyz", strict=True)}
    mapping = {"time": "t", "joints": entries}
    same(ident.read_log(stacked, driven_arm.mechanism(), mapping))
    some = {**mapping, "select": {"time": [[1.0, 3.0]]}}
    selected = ident.read_log(stacked, driven_arm.mechanism(), some)
    assert np.ptp(selected.time) == pytest.approx(2.0, abs=0.03)
    untimed = {"rate": 50.0, "joints": entries, "select": {"time": [1.0, 3.0]}}
    assert ident.read_log(stacked, driven_arm.mechanism(), untimed).time[[0, -1]].tolist() == [1.0, 3.0]
    with pytest.raises(LogError, match=r"The dict of columns: .*\[joints\] has no entry 'knee'"):
        ident.read_log(stacked, driven_arm.mechanism(), {"joints": {"knee": {}}})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": np.arange(3.0)}, "columns need one length, but 'time' has 3 samples and 'turn_position' has 200"),
        ({"turn_torque": ["a"] * 200}, "column 'turn_torque' needs numbers, got <U1"),
        ({"turn_torque": 3.0}, r"column 'turn_torque' needs a number for each sample, got shape \(\)"),
        ({"turn_position": np.full(200, np.nan)}, "turn"),
        ({1: np.zeros(200), "1": np.zeros(200)}, "two columns are named '1'; each needs a name of its own"),
        ({"q": np.zeros((200, 3)), "q.x": np.zeros(200)}, "two columns are named 'q.x'"),
    ],
)
def test_bad_columns_are_one_sentence(change, message):
    with pytest.raises(LogError, match=f"The dict of columns: .*{message}"):
        ident.read_log(columns() | change, driven_arm.mechanism())


@pytest.mark.parametrize(
    ("given", "where"), [(3, "recording"), (None, "recording"), ([columns(), 3], r"recording\[1\]")]
)
def test_what_is_no_recording_is_one_sentence(given, where):
    expected = f"^{where} needs a Recording, the path of a log, a mapping of arrays, a pandas DataFrame or an xarray"
    with pytest.raises(InputError, match=expected):
        ident.identify(driven_arm.mechanism(), given)
    with pytest.raises(InputError, match=r"^A log needs the path of a file, or a mapping of arrays, .*; got 3\.$"):
        ident.read_log(3, driven_arm.mechanism())
    with pytest.raises(InputError, match=r"got \['a.csv', 'b.csv'\]. Read each by itself, or give `identify` the"):
        ident.read_log(["a.csv", "b.csv"], driven_arm.mechanism())
