"""Scores images and masks, by one of several protocols, for the report of `ns-eval`.

May import `photo_tourism`, `training`, `gaussians`, `rendering`, `backend`, `data`, `settings`,
`console` and `errors`.
"""
