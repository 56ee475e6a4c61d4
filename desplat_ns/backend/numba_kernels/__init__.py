"""Compiled code by itself: the kernels of the numba backend.

Each module is one piece of work. `runtime` has them compiled and launches them.
"""
