"""Settings that must precede numpy's first import."""

import os

# One thread is faster on the tests' small matrices, and does not compete with whatever else the machine does.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
