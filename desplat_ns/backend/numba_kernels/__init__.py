"""Compiled code by itself: the kernels of the numba backend.

Each module is one piece of work. `runtime` launches them, `launches` lists them, `compiling` has
those compiled that a machine lacks.
"""

from desplat_ns.backend.numba_kernels import compiling  # it is asked before the first launch

__all__ = ["compiling"]
