import os
from pathlib import Path

import pytest

from ident.files.atomic import replacing, unwritten

FULL = Path("/dev/full")


def write(path, text):
    with replacing(path) as temporary:
        assert temporary.suffix == path.suffix
        temporary.write_text(text)


@pytest.mark.skipif(not FULL.exists(), reason="this system has no /dev/full")
def test_a_full_disk_is_one_sentence_and_leaves_the_old_file(tmp_path):
    write(tmp_path / "a.csv", "first")
    sentence = (
        rf"^'{tmp_path}/a.csv' could not be written \({os.strerror(28)}\) and is as it was; "
        r"make room or write elsewhere, and run again\.$"
    )
    with pytest.raises(OSError, match=sentence), replacing(tmp_path / "a.csv") as temporary:
        temporary.unlink()
        temporary.symlink_to(FULL)
        temporary.write_text("second")
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a.csv", "first")]


def test_of_nested_blocks_the_outermost_names_the_place_and_the_innermost_the_reason():
    with (
        pytest.raises(OSError, match=r"^'folder' could not be written \(encoder error -2\)"),
        unwritten(Path("folder")),
        unwritten(Path("file")),
    ):
        raise OSError("encoder error -2")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_what_is_no_regular_file_is_not_replaced(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    (tmp_path / "folder.csv").mkdir()
    for path in (tmp_path / "pipe.csv", tmp_path / "folder.csv"):
        before = path.stat()
        with pytest.raises(OSError, match=rf"^'{path}' could not be written \(it is no regular file\)"):
            write(path, "new")
        assert path.stat() == before
    assert len(list(tmp_path.iterdir())) == 2
