"""Rasterizers on generated Gaussians: how exact, how fast and how frugal each is, and what being
more exact costs. It may import `studies.grid` and `desplat_ns` outside of `studies`.
"""
