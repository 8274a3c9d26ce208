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


def episode(k, rows=N):
    """Features of an episode, different for each."""
    q = np.rad2deg(np.resize(Q, (rows, 2))) + k
    return {"observation.state": q, "action": q + 0.5, "next.reward": np.arange(rows) + 1.0 * k}


def dataset(folder, numbers=(0, 1, 2, 3, 5), version=3, names=NAMES, **options):
    write_lerobot(folder, {k: episode(k, N + 10 * k) for k in numbers}, version, names, **options)
    return folder


def table(path):
    (only,) = read_tables(path)
    return only


def refusal(path, read=table):
    sentence = sentence_of(read, path)
    assert len(sentence) < 400 and sentence.endswith((".", ".)"))
    return sentence


def changed(folder, **entries):
    path = folder / "meta/info.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | entries))


def with_names(folder, names):
    features = json.loads((folder / "meta/info.json").read_text())["features"]
    features["observation.state"]["names"] = names
    changed(folder, features=features)


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("k", [0, 1, 2, 5])
def test_an_episode_is_read_by_the_names_of_its_components(tmp_path, version, k):
    folder = dataset(tmp_path / "pick", version=version)
    there, expected = table(tmp_path / f"pick#{k}"), episode(k, N + 10 * k)
    assert list(there.cells) == [
        "time",
        *("observation.state.ankle.pos", "observation.state.hip.pos", "action.ankle.pos", "action.hip.pos"),
        "next.reward",
    ]
    for name in ("observation.state", "action"):
        x = np.stack([there.cells[f"{name}.{joint}.pos"] for joint in JOINTS], axis=1)
        np.testing.assert_array_equal(x, expected[name])
    np.testing.assert_array_equal(there.cells["next.reward"], expected["next.reward"])
    np.testing.assert_allclose(there.cells["time"], np.arange(N + 10 * k) / 100, atol=1e-6)
    assert there.units == {"time": "SI"}
    at = k if version == 2 else k // 2
    name = f"episode_{at:06d}.parquet" if version == 2 else f"file-{at:03d}.parquet"
    assert files_in(tmp_path / f"pick#{k}") == (folder / "meta/info.json", folder / "data/chunk-000" / name)


def test_lists_of_any_length_are_read_where_all_have_that_of_the_description(tmp_path):
    folder = dataset(tmp_path / "d", [0], 2)
    path = folder / "data/chunk-000/episode_000000.parquet"
    content = parquet.read_table(path)
    state = content.column("observation.state").combine_chunks()
    at = content.column_names.index("observation.state")
    as_lists = state.to_pylist()
    parquet.write_table(content.set_column(at, "observation.state", pyarrow.array(as_lists)), path)
    np.testing.assert_array_equal(
        table(folder).cells["observation.state.hip.pos"], episode(0)["observation.state"][:, 1]
    )
    as_lists[7] = [1.0, 2.0, 3.0]
    parquet.write_table(content.set_column(at, "observation.state", pyarrow.array(as_lists)), path)
    assert "frame 7 needs 2 numbers in 'observation.state', as meta/info.json has them; it has 3." in refusal(folder)
    parquet.write_table(content.set_column(at, "observation.state", pyarrow.array(T)), path)
    assert "'observation.state' needs vectors of 2 numbers, as meta/info.json has them; it has" in refusal(folder)


@pytest.mark.parametrize("version", [2, 3])
def test_an_episode_that_is_absent_or_not_chosen(tmp_path, version):
    folder = dataset(tmp_path / "d", (0, 1, 2, 5), version)
    there = "the dataset has episodes 0 to 2, 5."
    assert refusal(folder) == f"an episode of the dataset is chosen as d#0; {there}"
    for asked in ("3", "first", "", "-1", "1.0"):
        numbered = f"an episode is chosen by its number, got '{asked}'; {there}"
        expected = numbered if asked else "an episode of the dataset is chosen as d#0"
        assert expected in refusal(tmp_path / f"d#{asked}")
    if version == 2:
        (folder / "data/chunk-000/episode_000002.parquet").unlink()
        assert "the dataset has episodes 0 to 1, 5." in refusal(tmp_path / "d#2")
    else:
        (folder / "data/chunk-000/file-001.parquet").unlink()
        assert "episode 5 is in data/chunk-000/file-001.parquet, which does not exist." in refusal(tmp_path / "d#5")


def test_descriptions_that_are_refused(tmp_path):
    folder = dataset(tmp_path / "d", [0])
    with_names(folder, ["ankle"])
    assert "needs a name for each of the 2 components of 'observation.state', or null; it has 1." in refusal(folder)
    with_names(folder, "ankle")
    assert "components of 'observation.state', or null; it has no list." in refusal(folder)
    changed(folder, features=None)
    assert "meta/info.json of a LeRobot dataset needs 'features'" in refusal(folder)
    for version in ("v1.6", "v4.0", None, 3, "x" * 100):
        changed(folder, codebase_version=version)
        assert "LeRobot's datasets of versions 2 and 3 are read; meta/info.json says" in refusal(folder)
    for text in ("", "[]", '{"codebase_version": ', "[" * 10_000, "\x00"):
        (folder / "meta/info.json").write_text(text)
        assert "a LeRobot dataset, whose meta/info.json describes it in JSON" in refusal(folder)
    (folder / "meta/info.json").unlink()
    assert refusal(folder) == "the folder needs metadata.yaml of a ROS 2 bag or meta/info.json of a LeRobot dataset."


def test_data_that_are_refused(tmp_path):
    folder = dataset(tmp_path / "d", [0, 1])
    file, listed = folder / "data/chunk-000/file-000.parquet", folder / "meta/episodes/chunk-000/file-000.parquet"
    whole, content = file.read_bytes(), parquet.read_table(file)
    for column in ("timestamp", "episode_index", "action"):
        parquet.write_table(content.drop_columns([column]), file)
        assert f"data/chunk-000/file-000.parquet needs a column '{column}'" in refusal(tmp_path / "d#1")
    parquet.write_table(content.slice(0, N), file)
    assert "data/chunk-000/file-000.parquet has no rows of episode 1." in refusal(tmp_path / "d#1")
    for damaged in (b"", whole[: len(whole) // 2], b"PAR1" + bytes(500)):
        file.write_bytes(damaged)
        assert "a LeRobot dataset, and data/chunk-000/file-000.parquet a parquet file" in refusal(tmp_path / "d#1")
    listed.write_bytes(b"PAR1")
    assert "a LeRobot dataset that lists its episodes" in refusal(tmp_path / "d#1")
    shutil.rmtree(folder / "meta/episodes")
    assert "has its first episode in meta/episodes/chunk-000/file-000.parquet; here is" in refusal(tmp_path / "d#1")
