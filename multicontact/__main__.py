"""The command as `python -m multicontact NAME`."""

import sys
from pathlib import Path

# A folder named experiments where Python was started would come first.
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from experiments.cli.command import main

if __name__ == "__main__":
    sys.exit(main())
