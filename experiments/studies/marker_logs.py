"""Logs with positions of markers instead of angles, `TRIAL.trc+PLATES.mot`: angles are fitted first."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from ident.errors import InputError, LogError
from ident.files.readers import read_markers
from ident.recordings.several_files import files_of

MARKERS = ".trc"
"""Suffix of files that hold only markers."""


@contextmanager
def with_angles(
    source: Path, log: Path, base: str | None = None, fix: Mapping[str, Sequence[float]] | None = None
) -> Iterator[tuple[Path, list[str]]]:
    """Yields a log in which files of fitted angles replace those of markers, for the duration of a block.

    Args:
        source: MJCF, URDF or OpenSim file, whose sites or markers are named like the labels.
        log: The log, one file or several joined by `+`.
        base: Body whose frame is {0}.
        fix: Joints that do not move.

    Yields:
        The log to read, unchanged if it has no markers, and sentences on the fit.

    Raises:
        ModelError: The model cannot be read.
        InputError: The markers do not belong to the model, or do not determine a joint that is not fixed.
        LogError: A file of markers is missing or damaged, or the block raises one for any file.
    """
    if not any(file.suffix.lower() == MARKERS for file in files_of(log)):
        yield log, []
        return
    with TemporaryDirectory() as folder:
        files, notes = [], list[str]()
        for file in files_of(log):
            if file.suffix.lower() == MARKERS:
                notes += _fitted(source, file, base, fix or {}, angles := Path(folder) / f"{file.stem}.csv")
                file = angles
            files.append(str(file))
        try:
            yield Path("+".join(files)), notes
        except LogError as error:
            raise LogError(str(error).replace("+".join(files), str(log))) from None


def _fitted(source: Path, file: Path, base: str | None, fix: Mapping[str, Sequence[float]], out: Path) -> list[str]:
    """Writes the angles of a trial, and returns sentences on the fit."""
    # Imported here because few logs have markers.
    from sim.markers.marked_model import base_of, marked_model, marked_positions
    from sim.markers.trial_fit import check_fit, fit_trial
    from sim.markers.trial_recording import recording

    markers = read_markers(file)
    marked, unmatched = marked_model(source, markers.labels, fix=fix)
    postures = fit_trial(marked, marked_positions(markers, unmatched, marked, None))
    try:
        check_fit(postures)
    except InputError as error:
        raise InputError(f"{file}: {error}") from None
    trial = recording(postures, markers.time, base_of(marked.model, base) if base else None)
    still = postures.undetermined
    if still:
        raise InputError(
            f"{file}: the markers do not determine {', '.join(still)}; leave what they do not tell of out by "
            f"{' '.join(f'--fix {name}' for name in still)}."
        )
    trial.save(out)
    left_out = f" No marker of the model is called {', '.join(unmatched)}." if unmatched else ""
    return [
        f"Angles are fitted to {len(marked.labels)} markers of {file.name}, with noise of {1e3 * postures.sigma:.2g} "
        f"mm in each coordinate; `multicontact angles` says more of that.{left_out}",
        *trial.notes,
    ]
