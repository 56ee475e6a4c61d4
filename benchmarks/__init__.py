"""How fast, how exact and how frugal every backend is, measured in one run: `make bench`."""

import os

# Before anything loads OpenMP: waiting threads that spin would be counted as work.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
