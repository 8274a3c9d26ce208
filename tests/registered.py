"""Entries of the registry for the tests: text of a file, and small recordings of a simulated arm in an entry's form."""

import hashlib

import driven_arm
from written_formats import write_csv

TEXT = """
title = "Arm"
about = "A simulated arm."
folder = "arm"
tried = true
model = "arm.xml"
fitted = [["one.csv"], ["two.csv"]]

[source]
repository = "somebody/arms"
commit = "0123abc"
licence = "MIT"

{files}
{more}
"""

FILE = '[[files]]\nname = "{name}"\npath = "data/{name}"\nsha256 = "{sha256}"\n'


def written(folder, text, name="arm"):
    path = folder / f"{name}.toml"
    path.write_text(text, encoding="utf-8")
    return path


def files_of(folder):
    return "\n".join(
        FILE.format(name=path.name, sha256=hashlib.sha256(path.read_bytes()).hexdigest())
        for path in sorted(folder.iterdir())
    )


def recorded(folder):
    folder.mkdir()
    (folder / "arm.xml").write_text(driven_arm.text(), encoding="utf-8")
    for name, seed in (("one", 0), ("two", 1)):
        log = driven_arm.log(8.0, 50.0, seed=seed)
        write_csv(folder / f"{name}.csv", {"time": log.time, **log.measured})
