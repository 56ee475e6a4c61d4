"""Accuracy against time on one capture: rasterizers (`studies.pixels`), trainings (`studies.grid`)
and evaluations, and a report of all three. It may import `studies.pixels`, `studies.grid` and
`desplat_ns` outside of `studies`.
"""
