"""Trainings that are compared, and recorded once each. `records` has the format of what was
measured, `machine` what it was measured on, `runs` does the runs that have no record yet, here or
on Ray; `train_and_score` is the program that does one, `methods` reads methods, their options and
captures.

`desplat-tradeoff` compares lengths and variants on a user's capture: `tradeoff` chooses and does
the runs, `page` says which differences are real. `desplat-reproduce` makes the paper's tables:
`paper` has the data sets, methods, metrics and published figures, `reproduce` finds the scenes,
does the runs and writes the table.
"""
