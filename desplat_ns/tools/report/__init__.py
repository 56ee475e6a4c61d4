"""A trained run on one HTML page: its photos, renderings, scores, effects and warnings.

`pictures` renders photos; `views` judges what the training photos see of the scene; `notices` says
what stands out and what to try; `page` gathers all of it, says which effects there were and why,
and writes, with the scene itself on top: `page.write_report`.
"""
