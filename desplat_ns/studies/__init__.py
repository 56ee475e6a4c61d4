"""Trainings that are compared. `runs` has what is run: a variant of a method for some steps with a
seed, in a process of its own, on this machine or on Ray (`executors`). `desplat-tradeoff` compares
lengths and variants on a user's capture: `plan` says which, `pace` what fits into the time, `study`
does it, `summary` says what may be claimed, `report` writes the page.

Works without a checkout; may import all of `desplat_ns`, which imports nothing from here.
"""
