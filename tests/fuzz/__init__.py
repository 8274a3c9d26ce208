"""Damaged models, logs, mappings and options: each has to be refused in a sentence or accepted."""

import sys
from pathlib import Path

# Whoever runs it as a command has not got what the tests share on the path.
sys.path.append(str(Path(__file__).parents[1]))
