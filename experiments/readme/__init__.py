"""Generated parts of README.md and of the documentation."""
