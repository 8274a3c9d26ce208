"""The studies a user runs: `python -m experiments.NAME`."""

import sys
from pathlib import Path

# Python is looking for the module that -m names, or is running the command's script: what follows is imports only.
if sys.argv and (sys.argv[0] == "-m" or Path(sys.argv[0]).stem == "multicontact"):
    from experiments.runs import end_silently

    end_silently()
