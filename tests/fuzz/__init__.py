"""Damaged models, logs, mappings and options: each has to be accepted, or rejected with one sentence."""

import sys
from pathlib import Path

# As a command, the package does not have the tests' helpers on its path.
sys.path.append(str(Path(__file__).parents[1]))
