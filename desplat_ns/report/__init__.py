"""A trained run on one HTML page: its photos, renderings, scores, curves, effects and warnings.

`history`, `effect_reasons`, `cost`, `pictures`, `next_photos` and `failure_case` gather what is
known of it; `notices` says what stands out and what to try; `page` writes, with the scene itself
on top. `report.write_report` is the one function.

May import `scene`, `runs`, `run_config`, `pipeline`, `model`, `separation`, `training`,
`evaluation`, `gaussians`, `rendering`, `backend`, `data`, `settings`, `files`, `console` and
`errors`.
"""
