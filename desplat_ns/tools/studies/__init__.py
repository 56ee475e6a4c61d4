"""Trainings that are compared, and recorded once each (`records`), on a `machine`, by `runs`.
`methods` reads methods and captures.

`desplat-tradeoff` compares lengths and variants on a user's capture: `tradeoff`.
`desplat-reproduce` makes the paper's tables: `paper` has them, `reproduce` does the runs."""
