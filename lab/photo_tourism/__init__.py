"""Each effect on and off, on photos of changing light: docs/results/photo_tourism.md. It may import
all of `desplat_ns`.
"""
