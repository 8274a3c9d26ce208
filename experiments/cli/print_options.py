"""Options of authors: page, captions, parameters and style of tables and figures."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.errors import InputError

if TYPE_CHECKING:
    from experiments.document.layout import Layout
    from experiments.document.writer import Output


def add_print(parser: argparse.ArgumentParser) -> None:
    """Adds the options; `layout_of` and `style_of` return their values."""
    print_ = add_page(parser)
    print_.add_argument(
        "--caption",
        nargs=2,
        action="append",
        default=[],
        metavar=("NAME", "TEXT"),
        help="caption in LaTeX for the table or figure of that name, as table_3; once for each",
    )
    print_.add_argument(
        "--parameters",
        nargs="+",
        default=[],
        metavar="NAME",
        help="parameters that tables in LaTeX and figures show, by symbol as m2rz2 or by body, by default all",
    )


def add_page(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """Adds those options that all results share, and returns their group."""
    print_ = parser.add_argument_group("print")
    print_.add_argument(
        "--page-columns", type=int, choices=(1, 2), default=2, help="columns of the page that tables and figures fit"
    )
    print_.add_argument(
        "--brackets",
        action="store_true",
        help="tables in LaTeX with standard deviations in brackets behind their estimates, as 2.519(31), by siunitx",
    )
    print_.add_argument("--style", type=Path, help="style file of matplotlib's, whose settings go before the paper's")
    return print_


def output_of(args: argparse.Namespace, folder: Path | None = None, formats: Sequence[str] | None = None) -> "Output":
    """Folder, formats and layout that the options ask for, with other ones in place of the first two if given.

    Raises:
        InputError: A table or figure is given two captions.
    """
    from experiments.document.writer import Output

    folder, formats = folder or args.out, args.formats if formats is None else formats
    return Output(folder, formats, layout_of(args), choices=author_choices(args))


def layout_of(args: argparse.Namespace) -> "Layout":
    """Layout that the options ask for.

    Raises:
        InputError: A table or figure is given two captions.
    """
    from experiments.document.layout import Layout

    given = getattr(args, "caption", [])
    captions = {name: text for name, text in given}
    if len(captions) < len(given):
        raise InputError("--caption gives each table or figure one caption, but one of them is given two.")
    return Layout(args.page_columns, captions, tuple(getattr(args, "parameters", ())), getattr(args, "brackets", False))


@contextmanager
def style_of(args: argparse.Namespace) -> Iterator[None]:
    """Draws figures in the page's column width and the author's style, for the duration of a block.

    Raises:
        InputError: The style file does not exist, has a setting unknown to matplotlib, or makes figures that cannot be
            drawn; or a table or figure is given two captions.
    """
    if "page_columns" not in args:
        yield
        return
    layout_of(args)
    from experiments.document.styles import author_style

    with author_style(args.style, args.page_columns):
        if args.style is not None:
            from experiments.document.style_trial import try_style

            try_style(args.style)
        yield


def author_choices(args: argparse.Namespace) -> dict[str, Any]:
    """Options that differ from their defaults, for the provenance."""
    given = {
        "page_columns": args.page_columns if args.page_columns != 2 else None,
        "brackets": getattr(args, "brackets", False),
        "style": args.style and args.style.name,
    }
    given |= {name: getattr(args, name, None) for name in ("caption", "parameters")}
    return {name: value for name, value in given.items() if value}
