"""Puts faults into rooms of `ident` one at a time, drawn by chance, and counts those that make a test fail.

Each is put into a copy of the repository, and the tests that execute its line are run. A fault that survives is
either without effect for every input, or shows a missing test.
"""

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from queue import SimpleQueue

from tqdm import tqdm

from .covered import Covered
from .drawn import Mutant, drawn, mutants_of
from .trials import copied, trial

REPOSITORY = Path(__file__).parents[2]


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code: 1 if fewer than the asked share were killed."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("rooms", nargs="+", metavar="ROOM", help="folder or file, as ident/judgement")
    parser.add_argument("--number", type=int, default=200, help="number of faults")
    parser.add_argument("--seed", type=int, default=0, help="seed of their choice")
    parser.add_argument("--workers", type=int, default=1, help="faults that are tried at once")
    parser.add_argument(
        "--seconds", type=float, default=25.0, help="what tests of one may take; slower ones are left out"
    )
    parser.add_argument("--only", type=int, nargs="+", metavar="K", help="try these of the drawn ones alone")
    parser.add_argument("--least", type=float, default=0.85, help="share that has to be killed")
    parser.add_argument("--out", type=Path, default=Path("results/mutants"), help="folder of what tests execute")
    options = parser.parse_args(argv)
    files = _files(parser, options.rooms)
    if find_spec("coverage") is None:
        parser.error("coverage is not installed: pip install -e '.[dev]'.")
    every = [mutant for path in files for mutant in mutants_of(path, _text(path))]
    mutants = dict(enumerate(drawn(every, options.number, options.seed)))
    chosen = {k: mutants[k] for k in options.only or mutants if k in mutants}
    endings = tried(chosen, options.out, options.workers, options.seconds)
    print(table(chosen, endings))
    killed = sum(ending.startswith("killed") for ending in endings.values())
    print(f"{killed} of {len(endings)} killed: {killed / max(len(endings), 1):.0%}")
    return 0 if killed >= options.least * len(endings) else 1


def tried(mutants: dict[int, Mutant], out: Path, workers: int, seconds: float) -> dict[int, str]:
    """Endings of the tests with each fault."""
    with tempfile.TemporaryDirectory() as folder:
        copies = SimpleQueue[Path]()
        for k in range(workers):
            copies.put(copied(REPOSITORY, Path(folder) / str(k)))
        first = copies.get()
        covered = Covered(REPOSITORY, out, first)
        copies.put(first)

        def tried_on_a_copy(item: tuple[int, Mutant]) -> tuple[int, str]:
            copy = copies.get()
            try:
                return item[0], trial(copy, covered, item[1], seconds)
            finally:
                copies.put(copy)

        with ThreadPoolExecutor(workers) as pool, (out / "endings.jsonl").open("w", encoding="utf-8") as file:
            endings = {}
            for k, ending in tqdm(pool.map(tried_on_a_copy, mutants.items()), total=len(mutants), desc="Faults"):
                endings[k] = ending
                file.write(json.dumps([k, ending]) + "\n")
                file.flush()
        return endings


def table(mutants: dict[int, Mutant], endings: dict[int, str]) -> str:
    """One line for each fault, survivors last, and the counts by kind."""
    rows = []
    for k in sorted(mutants, key=lambda k: endings[k].startswith("survived")):
        fault, (ending, _, why) = mutants[k], endings[k].partition(": ")
        change = f"{fault.kind}: {_short(fault.before)} -> {_short(fault.after)}"
        rows.append(f"{k:4d} {ending:8}  {fault.path}:{fault.line}  {change}  ({why})")
    kinds = Counter(mutants[k].kind for k, ending in endings.items() if ending.startswith("survived"))
    return "\n".join([*rows, "Survived: " + (", ".join(f"{n} {kind}" for kind, n in kinds.most_common()) or "none")])


def _files(parser: argparse.ArgumentParser, rooms: Sequence[str]) -> list[str]:
    """Python files of rooms, from the repository's folder."""
    out = []
    for room in rooms:
        place = REPOSITORY / room
        files = sorted(place.rglob("*.py")) if place.is_dir() else [place] if place.suffix == ".py" else []
        if not (files and all(file.is_file() and file.is_relative_to(REPOSITORY / "ident") for file in files)):
            parser.error(f"a room is a folder or file of ident, as ident/judgement; got {room}.")
        out += [str(file.relative_to(REPOSITORY)) for file in files]
    return list(dict.fromkeys(out))


def _text(path: str) -> str:
    return (REPOSITORY / path).read_text(encoding="utf-8")


def _short(text: str, most: int = 60) -> str:
    words = " ".join(text.split())
    return words if len(words) <= most else words[: most - 1] + "…"


if __name__ == "__main__":
    sys.exit(main())
