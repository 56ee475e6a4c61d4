"""Everything that only a GPU can answer, in one command of ten minutes: `make gpu`.

`plan` says which parts there are, `runner` runs each in a process of its own with its own deadline,
`parts/` holds one file for each, `report` writes docs/results/gpu.md. `collect` gathers the wheels
for a machine without a network, `environment` makes the environment of them there.
"""
