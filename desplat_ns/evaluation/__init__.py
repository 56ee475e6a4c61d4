"""Scores images and masks, by one of several protocols, for the report of `ns-eval`.

May import `photo_tourism`, `gaussians`, `data`, `console` and `errors`.
"""
