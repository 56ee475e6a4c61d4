"""Rasterizers on generated Gaussians: how exact, how fast and how frugal each is, and what being
more exact costs. It may import `lab.grid` and all of `desplat_ns`.
"""
