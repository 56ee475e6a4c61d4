"""The paper's tables, for `desplat-reproduce`: how each data set is trained on and scored
(`protocols`, `methods`), which figures a table has (`tables`) and which the paper has (`paper`),
where the scenes lie (`scenes`), what it takes (`estimate`), the runs (`grid`, over those of
`studies`, kept by `records`), what they say (`cells`, `results`) and how it is written (`writing`).
`grid.reproduce` is the one function.

May import `studies`, `calibration`, `evaluation`, `rendering`, `settings`, `files`, `console` and
`errors`.
"""
