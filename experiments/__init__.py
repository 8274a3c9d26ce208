"""The studies a user runs: `python -m experiments.NAME`."""

import sys
from pathlib import Path

# Python looks for the module that -m names, or runs the script of the command: all that follows are imports.
if sys.argv and (sys.argv[0] == "-m" or Path(sys.argv[0]).stem == "multicontact"):
    from experiments.runs.signals import end_silently

    end_silently()
