"""The laboratory: what the project measures for itself. Only a checkout has it.

Scenes with known truth (`synthetic`), studies with the documents that they write into `docs/`,
checks of machines and GPUs. It imports `desplat_ns`, which imports nothing of it.
"""

import os

# Before anything loads OpenMP: waiting threads that spin would be counted as work.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
