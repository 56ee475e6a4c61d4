"""This repository's own engineering: what its documents in docs/ say is measured here. It may
import all of `desplat_ns`, its studies among them, and is not in the wheel.
"""

import os

# Before anything loads OpenMP: waiting threads that spin would be counted as work.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
