"""Builds what draws a scene in a page: libraries of others, pinned, in one bundle.

`python -m lab.viewer` (or `make viewer`) writes `desplat_ns/scene/viewer`, which is committed; a
test holds the committed files against the checksums in `pins.json`.
"""
