"""The paper's tables, for `desplat-reproduce`: how each data set is trained on and scored
(`protocols`, `methods`), which figures a table has (`tables`) and which the paper has (`paper`),
where the scenes lie (`scenes`), the runs (`grid`, by those of `studies`) and how a table is written
(`writing`). `grid.reproduce` is the one function.

May import `studies`, `evaluation`, `rendering`, `settings`, `files`, `console` and `errors`.
"""
