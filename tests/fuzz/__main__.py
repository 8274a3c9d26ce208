"""Runs commands on damaged input in one process, and counts how the cases end.

Case k is the same for the same seed, whatever ran before. An interrupted run goes on where it stopped; a case that took
the process with it counts as dead. Ends with 1 unless every case was refused in a sentence or accepted.
"""

import argparse
import faulthandler
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from .cases import CLEAN, Runner
from .journal import Journal

STUCK = 600
"""Seconds after which a case is ended together with the process."""


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="number of cases")
    parser.add_argument("--seed", type=int, default=0, help="seed of all cases")
    parser.add_argument("--only", type=int, metavar="K", help="run case K alone and show what it prints")
    parser.add_argument("--out", type=Path, default=Path("results/fuzz"), help="folder of the journal")
    options = parser.parse_args(argv)
    with Runner(options.seed) as runner:
        if options.only is not None:
            print(runner.run(options.only).story)
            return 0
        journal = Journal(options.out / f"seed-{options.seed}.jsonl")
        for k in tqdm(range(options.cases), desc="Cases"):
            if k not in journal.endings:
                # Where Python cannot interrupt a library, the process ends, and the journal knows.
                faulthandler.dump_traceback_later(STUCK, exit=True, file=sys.__stderr__)
                with journal.entry(k) as note:
                    note(runner.run(k))
                faulthandler.cancel_dump_traceback_later()
    endings = [journal.endings[k] for k in range(options.cases)]
    unclean = [ending for ending in endings if ending["ending"] not in CLEAN]
    for place, cases in Counter(ending["what"] for ending in unclean).most_common():
        first = next(ending for ending in unclean if ending["what"] == place)
        print(f"{cases} x {first['ending']}: {place} (first case {first['case']})")
    print(", ".join(f"{count} {ending}" for ending, count in Counter(e["ending"] for e in endings).most_common()))
    return 1 if unclean else 0


if __name__ == "__main__":
    sys.exit(main())
