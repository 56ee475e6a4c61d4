"""Trainings that are compared. `records` has the one format of what was measured, `runs` trains and
scores one run in a process of its own, `executors` does the runs that have no record yet.
`desplat-tradeoff` compares lengths and variants on a user's capture: `plan` chooses the runs that
fit into the time, `study` does them, `summary` says which differences are real, `report` writes the
page.

Works without a checkout; may import all of `desplat_ns`, which imports nothing from here.
"""
