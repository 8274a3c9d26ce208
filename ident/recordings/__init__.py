"""What was measured: recordings, the files that hold them, and the total wrench."""
