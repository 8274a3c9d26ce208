"""The command `validate --fetch` on a server of this machine: damaged, broken off, another file, and no network."""

from functools import partial

import pytest
from commands import refusal
from fuzz.here import Here
from loopback import server
from registered import TEXT, files_of, recorded, written

from experiments import validate
from experiments.runs import workers
from experiments.studies.validation import files
from experiments.studies.validation.files import Places

NAMES = ("arm.xml", "one.csv", "two.csv")


class Fetching:
    """The command with an entry that is published on a server.

    Attributes:
        contents: What is published, by file.
        cache: Folder of what was downloaded.
    """

    def __init__(self, folder, monkeypatch):
        recorded(folder / "published")
        text = TEXT.format(files=files_of(folder / "published", *NAMES), more="")
        entry = files.read_entry(written(folder, text))
        monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        monkeypatch.delenv(validate.VARIABLE, raising=False)
        monkeypatch.setattr(files, "registry", lambda: {"arm": entry})
        monkeypatch.setattr(workers, "Processes", Here)
        self.contents = {name: (folder / "published" / name).read_bytes() for name in NAMES}
        self.cache, self.out, self._patch = files.cache() / "arm", folder / "out", monkeypatch.setattr

    def arguments(self, url):
        self._patch(files, "Places", partial(Places, host=url))
        return ["arm", "--fetch", "--out", str(self.out), "--workers", "1", "--formats", "png"]


@pytest.fixture
def fetching(tmp_path, monkeypatch):
    return Fetching(tmp_path, monkeypatch)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_one_that_broke_off_is_downloaded_again_and_validated(fetching, capsys):
    short = fetching.contents["one.csv"][:500]
    with server({**fetching.contents, "one.csv": short}, whole=len(fetching.contents["one.csv"])) as (url, _):
        error = refusal(validate.main, fetching.arguments(url), capsys)
    assert "cannot be downloaded (it broke off" in error
    assert "Run it again" in error and not fetching.out.exists()
    with server(fetching.contents) as (url, _):
        assert validate.main(fetching.arguments(url)) == 0
    assert {name: (fetching.cache / name).read_bytes() for name in NAMES} == fetching.contents
    assert (fetching.out / "report.html").is_file()


@pytest.mark.parametrize("damage", [lambda x: x[:300] + b"#" + x[301:], lambda _: b""])
def test_a_damaged_or_another_file_is_refused_and_not_kept(fetching, capsys, damage):
    contents = {**fetching.contents, "two.csv": damage(fetching.contents["two.csv"])}
    with server(contents) as (url, _):
        error = refusal(validate.main, fetching.arguments(url), capsys)
    assert "two.csv' has the SHA-256" in error and "the registry expects" in error
    assert sorted(path.name for path in fetching.cache.iterdir()) == ["arm.xml", "one.csv"]
    assert not fetching.out.exists()


def test_without_a_network_there_is_one_sentence(fetching, capsys):
    with server(fetching.contents) as (url, _):
        pass
    error = refusal(validate.main, fetching.arguments(url), capsys)
    last = error.strip().splitlines()[-1]
    assert last.startswith("python -m experiments.validate: error: 'http://127.0.0.1") and "is there a network?" in last
    assert not fetching.out.exists()
