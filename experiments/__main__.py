"""Runs every study with its defaults: `python -m experiments`."""

import sys

from experiments import misaligned


def main() -> int:
    """Entry point; returns the exit code of the first study that fails, else 0."""
    return misaligned.main([])


if __name__ == "__main__":
    sys.exit(main())
