"""How fast, how exact and how frugal every backend is: docs/results/performance.md, `make bench`.

It may import all of `desplat_ns`.
"""
