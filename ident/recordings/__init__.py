"""Measured data: recordings, the files that hold them, and the total wrench."""
