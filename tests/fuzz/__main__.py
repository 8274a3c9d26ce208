"""Runs commands on damaged input in one process, and counts how the cases end.

Case k is the same for the same seed, whatever ran before. Ends with 1 unless every case was refused in a sentence or
accepted.
"""

import argparse
import faulthandler
import sys
from collections import Counter
from collections.abc import Sequence

from tqdm import trange

from .cases import CLEAN, Runner

STUCK = 600
"""Seconds after which a case is ended together with the process: Python cannot interrupt every library."""


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="number of cases")
    parser.add_argument("--seed", type=int, default=0, help="seed of all cases")
    parser.add_argument("--only", type=int, metavar="K", help="run case K alone and show what it prints")
    options = parser.parse_args(argv)
    counts, unclean = Counter(), False
    with Runner(options.seed) as runner:
        if options.only is not None:
            print(runner.run(options.only).story)
            return 0
        for k in trange(options.cases, desc="Cases"):
            faulthandler.dump_traceback_later(STUCK, exit=True, file=sys.__stderr__)
            ending = runner.run(k)
            faulthandler.cancel_dump_traceback_later()
            counts[ending.kind] += 1
            if ending.kind not in CLEAN:
                unclean = True
                print(f"{ending.kind}: {ending.what} (case {k})", flush=True)
    print(", ".join(f"{count} {kind}" for kind, count in counts.most_common()))
    return 1 if unclean else 0


if __name__ == "__main__":
    sys.exit(main())
