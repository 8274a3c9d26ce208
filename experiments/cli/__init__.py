"""Command-line options, and how commands end."""
