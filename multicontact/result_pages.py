"""Pages of results from Python, as the commands write them."""

from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from ident.annotations import WORDS
from ident.arguments import check_type, checked_path
from ident.display.text import PAGES
from ident.errors import InputError
from ident.estimate import Estimate


def report(estimate: Estimate, folder: str | Path, *, formats: Sequence[str] = ("png",)) -> Path:
    """Writes the tables, figures and page of an estimate, as `multicontact identify` does.

    In a notebook the estimate then shows a link to the page, which replays the recording.

    Args:
        estimate: The estimate.
        folder: Folder of the results, made if missing.
        formats: Formats of the figures, out of `pdf`, `png` and `svg`.

    Returns:
        The page.

    Raises:
        InputError: A format is unknown, the folder cannot be written, or another package is named `experiments`.
    """
    _check_neighbour()
    check_type("estimate", estimate, Estimate, WORDS["Estimate"])
    path = checked_path("folder", folder, "the path of a folder")
    from experiments.document.result_folder import provenance
    from experiments.document.writer import Output, written
    from experiments.reports import identify_report
    from experiments.studies.user_files import following

    chosen = () if isinstance(formats, str) or not isinstance(formats, Sequence) else tuple(dict.fromkeys(formats))
    if not chosen or not {*chosen} <= {"pdf", "png", "svg"}:
        raise InputError(f"formats needs some of pdf, png, svg; got {formats!r}.")
    origin, followed = provenance({"formats": chosen}), following(estimate)
    made = identify_report.document(estimate, _file(estimate), (), origin, following=followed)
    out = Output(path, chosen)
    written(made, out, stale=identify_report.OUTPUTS)
    PAGES[estimate] = page = out.folder / "report.html"
    return page


def _file(estimate: Estimate) -> Path | None:
    """File of the model; None for one that came as a specification or without a source."""
    source = estimate.prepared.mechanism.source
    file = getattr(source, "text", None) or getattr(source, "path", None)
    return Path(file) if isinstance(file, str | Path) else None


def _check_neighbour() -> None:
    """Refuses a package `experiments` that is not installed beside this one."""
    own, spec = Path(__file__).resolve().parents[1] / "experiments", find_spec("experiments")
    origin = None if spec is None or spec.origin is None else Path(spec.origin).resolve().parent
    if origin != own:
        raise InputError(
            f"A page needs multicontact's own package 'experiments', but {origin or 'none'} comes first on Python's "
            "path: start Python in another folder, or use the command `multicontact identify`."
        )
