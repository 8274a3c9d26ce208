"""Positions of markers in a log, which are no joints' columns: angles are fitted to them first."""

from collections.abc import Collection
from dataclasses import replace

from experiments.guesses.log_contents import LogContents
from ident.recordings.several_files import files_of

TRIAL = ".trc"
"""Suffix of files that hold only markers."""

FEW = 3
"""Smallest number of markers that show the pose of a body."""


def without_markers(contents: LogContents, sites: Collection[str]) -> LogContents:
    """The contents without positions of markers: of a file that holds markers, or named like sites of the model."""
    of_markers = any(file.suffix.lower() == TRIAL for file in files_of(contents.path))
    axes: dict[str, list[str]] = {}
    for name in contents.names:
        label, _, axis = name.rpartition(".")
        if axis.lower() in "xyz" and (of_markers or label.rpartition(":")[2] in sites):
            axes.setdefault(label, []).append(name)
    markers = {label: names for label, names in axes.items() if label and len(names) == 3}
    if len(markers) < FEW:
        return contents
    gone = {name for names in markers.values() for name in names}
    columns = {name: x for name, x in contents.columns.items() if name not in gone}
    constant = {name: x for name, x in contents.constant.items() if name not in gone}
    return replace(contents, columns=columns, constant=constant, markers=tuple(markers))
