"""LeRobot's datasets: episodes of both versions are read back by their names, and damaged ones are one sentence."""

import json
import shutil

import numpy as np
import pytest
from commands import sentence_of
from malformed_logs import JOINTS, N, Q, T
from written_formats import write_lerobot

from ident.files.readers import files_in, read_tables

pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is in the extra 'parquet'")
parquet = pytest.importorskip("pyarrow.parquet")

pytestmark = pytest.mark.extras

NAMES = {"observation.state": ["ankle.pos", "hip.pos"], "action": {"motors": ["ankle.pos", "hip.pos"]}}


def episode(k):
    """Features of an episode, different for each."""
    q = np.rad2deg(np.resize(Q, (N + 10 * k, 2))) + k
    return {"observation.state": q, "action": q + 0.5, "next.reward": np.arange(len(q)) + 1.0 * k}


def dataset(folder, numbers=(0, 1, 2, 3, 5), version=3):
    write_lerobot(folder, {k: episode(k) for k in numbers}, version, NAMES)
    return folder


def table(path):
    (only,) = read_tables(path)
    return only


def refusal(path):
    sentence = sentence_of(table, path)
    assert len(sentence) < 400 and sentence.endswith((".", ".)"))
    return sentence


@pytest.mark.parametrize("version", [2, 3])
def test_an_episode_is_read_by_the_names_of_its_components(tmp_path, version):
    folder = dataset(tmp_path / "pick", version=version)
    for k in (0, 1, 2, 5):
        there, vectors = table(tmp_path / f"pick#{k}"), ("observation.state", "action")
        names = [*(f"{name}.{joint}.pos" for name in vectors for joint in JOINTS), "next.reward"]
        assert list(there.cells) == ["time", *names] and there.units == {"time": "SI"}
        values = np.stack([there.cells[name] for name in names], axis=1)
        np.testing.assert_array_equal(values, np.column_stack(list(episode(k).values())))
        np.testing.assert_allclose(there.cells["time"], np.arange(N + 10 * k) / 100, atol=1e-6)
        name = f"episode_{k:06d}.parquet" if version == 2 else f"file-{k // 2:03d}.parquet"
        assert files_in(tmp_path / f"pick#{k}") == (folder / "meta/info.json", folder / "data/chunk-000" / name)


def test_lists_of_any_length_are_read_where_all_have_that_of_the_description(tmp_path):
    folder, column = dataset(tmp_path / "d", [0], 2), "observation.state"
    path = folder / "data/chunk-000/episode_000000.parquet"
    content = parquet.read_table(path)
    lists = content.column(column).combine_chunks().to_pylist()

    def write(values):
        at = content.column_names.index(column)
        parquet.write_table(content.set_column(at, column, pyarrow.array(values)), path)

    write(lists)
    np.testing.assert_array_equal(table(folder).cells[f"{column}.hip.pos"], episode(0)[column][:, 1])
    write([*lists[:7], [1.0, 2.0, 3.0], *lists[8:]])
    assert "frame 7 needs 2 numbers in 'observation.state', as meta/info.json has them; it has 3." in refusal(folder)
    write(T)
    assert "'observation.state' needs vectors of 2 numbers, as meta/info.json has them; it has" in refusal(folder)


@pytest.mark.parametrize(
    ("version", "file", "asked", "message"),
    [
        (2, "episode_000002.parquet", 2, "the dataset has episodes 0 to 1, 5."),
        (3, "file-001.parquet", 5, "episode 5 is in data/chunk-000/file-001.parquet, which does not exist."),
    ],
)
def test_an_episode_that_is_absent_or_not_chosen(tmp_path, version, file, asked, message):
    folder = dataset(tmp_path / "d", (0, 1, 2, 5), version)
    there = "the dataset has episodes 0 to 2, 5."
    assert refusal(folder) == f"an episode of the dataset is chosen as d#0; {there}"
    for given in ("3", "first", "-1", "1.0"):
        assert f"an episode is chosen by its number, got '{given}'; {there}" in refusal(tmp_path / f"d#{given}")
    assert "an episode of the dataset is chosen as d#0" in refusal(tmp_path / "d#")
    (folder / "data/chunk-000" / file).unlink()
    assert message in refusal(tmp_path / f"d#{asked}")


def test_descriptions_that_are_refused(tmp_path):
    folder = dataset(tmp_path / "d", [0])
    path = folder / "meta/info.json"
    info = json.loads(path.read_text())

    def changed(**entries):
        path.write_text(json.dumps(info | entries))
        return refusal(folder)

    for names, number in ((["ankle"], "1"), ("ankle", "no list")):
        state = {**info["features"]["observation.state"], "names": names}
        sentence = f"a name for each of the 2 components of 'observation.state', or null; it has {number}."
        assert sentence in changed(features=info["features"] | {"observation.state": state})
    assert "meta/info.json of a LeRobot dataset needs 'features'" in changed(features=None)
    for version in ("v1.6", "v4.0", None, 3):
        sentence = "LeRobot's datasets of versions 2 and 3 are read; meta/info.json says"
        assert sentence in changed(codebase_version=version)
    for text in ("", "[]", "[" * 10_000):
        path.write_text(text)
        assert "a LeRobot dataset, whose meta/info.json describes it in JSON" in refusal(folder)
    path.unlink()
    assert refusal(folder) == "the folder needs metadata.yaml of a ROS 2 bag or meta/info.json of a LeRobot dataset."


def test_data_that_are_refused(tmp_path):
    folder, asked, name = dataset(tmp_path / "d", [0, 1]), tmp_path / "d#1", "data/chunk-000/file-000.parquet"
    file, listed = folder / name, folder / "meta/episodes/chunk-000/file-000.parquet"
    whole, content = file.read_bytes(), parquet.read_table(file)
    for column in ("timestamp", "episode_index", "action"):
        parquet.write_table(content.drop_columns([column]), file)
        assert f"{name} needs a column '{column}'" in refusal(asked)
    parquet.write_table(content.slice(0, N), file)
    assert f"{name} has no rows of episode 1." in refusal(asked)
    for damaged in (b"", whole[: len(whole) // 2], b"PAR1" + bytes(500)):
        file.write_bytes(damaged)
        assert f"a LeRobot dataset, and {name} a parquet file" in refusal(asked)
    listed.write_bytes(b"PAR1")
    assert "a LeRobot dataset that lists its episodes" in refusal(asked)
    shutil.rmtree(folder / "meta/episodes")
    assert "has its first episode in meta/episodes/chunk-000/file-000.parquet; here is" in refusal(asked)
