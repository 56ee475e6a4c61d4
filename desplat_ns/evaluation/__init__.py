"""Scores images and masks, by one of several protocols, for the report of `ns-eval`.

May import `model`, `training`, `gaussians`, `rendering`, `data`, `settings`, `console` and
`errors`.
"""
