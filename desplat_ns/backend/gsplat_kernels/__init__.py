"""gsplat's CUDA kernels. Its wheel brings their sources; they are compiled once on each machine.

`kernels.unavailable_reason()` loads them, compiles them where they are missing, or says why there
are none. gsplat's own first use would compile as well: it looks for nvcc on PATH alone, prints
nothing where output is a pipe, and begins anew in every process after a failure.
"""
