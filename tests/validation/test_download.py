"""Downloads, from a server on this machine: whole, broken off, wrong, refused; and what may not be copied."""

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest
from loopback import server as loopback

from experiments.data.validation import Entry, Source, SourceFile
from experiments.studies.validation import download as downloads
from experiments.studies.validation.download import address, cache, download
from experiments.studies.validation.files import Places, checked, fetched
from ident.errors import InputError

CONTENT = bytes(range(256)) * 3000
SHA256 = hashlib.sha256(CONTENT).hexdigest()


def server(content=CONTENT, **options):
    """The server of loopback.py, of `CONTENT` by default."""
    return loopback(content, **options)


def test_a_file_is_downloaded_and_its_hash_returned(tmp_path):
    with server() as (url, asked):
        assert download(f"{url}/a.csv", tmp_path / "new" / "a.csv", SHA256) == SHA256
    assert (tmp_path / "new" / "a.csv").read_bytes() == CONTENT and asked == ["a.csv"]
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["a.csv"]


@pytest.mark.parametrize(
    ("content", "options", "message"),
    [
        (CONTENT + b"!", {}, f"the registry expects {SHA256}"),
        (CONTENT, {"largest": 1000}, "larger than the largest size"),
        (CONTENT[:1000], {"whole": len(CONTENT)}, "after 1000 of 768000"),
        *(
            (CONTENT, {"status": 302, "location": location}, "cannot be downloaded")
            for location in ("http://[::1", "https://exam ple.org/a", "https://example.org:port/", "data:,x")
        ),
    ],
)
def test_what_is_wrong_leaves_nothing_but_the_earlier_file(tmp_path, monkeypatch, content, options, message):
    monkeypatch.setattr(downloads, "LARGEST", options.pop("largest", downloads.LARGEST))
    (tmp_path / "a.csv").write_bytes(b"earlier")
    with server(content, **options) as (url, _), pytest.raises(InputError, match=message):
        download(f"{url}/a.csv", tmp_path / "a.csv", SHA256)
    assert (tmp_path / "a.csv").read_bytes() == b"earlier" and len(list(tmp_path.iterdir())) == 1


def test_a_refused_connection_is_a_sentence(tmp_path):
    with server() as (url, _):
        pass
    with pytest.raises(InputError, match=r"is there a network\?.*--data"):
        download(f"{url}/a.csv", tmp_path / "a.csv", SHA256)
    assert not (tmp_path / "a.csv").exists()


ENTRY = Entry(
    *("arm", "Arm", "An arm.", "arm", True),
    Source("somebody/arms", "0123abc", "MIT"),
    (SourceFile("a.csv", "data/a b.csv", SHA256),),
)


@pytest.mark.parametrize("licence", ["", "proprietary"])
def test_what_may_not_be_copied_is_not_downloaded(licence):
    entry = replace(ENTRY, source=replace(ENTRY.source, licence=licence))
    with pytest.raises(InputError, match=r"lets nobody copy it.*--data"):
        address(entry, entry.files[0])


def test_a_file_of_unknown_origin_is_not_downloaded():
    with pytest.raises(InputError, match=r"where 'b.csv' is published is not known.*--data"):
        address(ENTRY, SourceFile("b.csv"))


def test_files_are_fetched_once(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache() == tmp_path / "multicontact" / "recordings"
    with server() as (url, asked):
        places = Places((tmp_path / "absent",), fetch=True, host=url)
        folder = places.folder(ENTRY)
        assert places.folder(ENTRY) == fetched(ENTRY, folder, url) == folder == cache() / "arm"
    assert asked == ["a%20b.csv"] and checked(ENTRY, folder) == ()
    with pytest.raises(InputError, match=r"has no a\.csv; --fetch"):
        Places((tmp_path / "absent",)).folder(replace(ENTRY, folder="other"))
    with pytest.raises(InputError, match="--fetch downloads them, or --data FOLDER"):
        Places().folder(replace(ENTRY, folder="other"))


def test_a_local_file_with_another_hash_is_refused(tmp_path):
    (tmp_path / "a.csv").write_bytes(CONTENT[:-1])
    with pytest.raises(InputError, match="another file than the one that was tried"):
        checked(ENTRY, tmp_path)


def test_a_published_file_is_converted_after_its_download(tmp_path):
    model = b'<robot name="r">\n<link name="base"/>\n</robot>\n'
    file = SourceFile("r.urdf", "r.urdf", "1" * 64, hashlib.sha256(model).hexdigest(), made="declared_world")
    entry = replace(ENTRY, files=(file,))
    with server(model) as (url, _):
        fetched(entry, tmp_path, url)
    assert '<link name="world"/>' in (tmp_path / "r.urdf").read_text(encoding="utf-8")
    assert [path.name for path in Path(tmp_path).iterdir()] == ["r.urdf"]
    # It may be written otherwise than the one that was tried.
    assert checked(entry, tmp_path) == ("r.urdf",)
