"""Reads captures: reconstructions, photos, masks, and which photos train and which are held out.

`reconstruction` has what is known of a capture's photos and scene, whatever file says so; COLMAP's
models are read into it (`colmap_model` finds them), and `poses` makes cameras and points of it.
Data parsers: `colmap`, `robustnerf` and `on_the_go` with splits of their own, and
`transforms_json`, which is upstream's still. `images` reads photos, `dataset` brings them to the
size of their cameras (`downscale`), `photo_cache` holds as many as there is room for.
"""
