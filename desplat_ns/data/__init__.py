"""Reads captures: reconstructions, photos, masks, and which photos train and which are held out.

`reconstruction` has what is known of a capture's photos and scene, whatever file says so; COLMAP's
models (`colmap_model` finds them) and transforms.json (`transforms_json`) are read into it, and
`poses` makes cameras and points of it. Data parsers: `colmap`, and, with splits of their own,
`robustnerf`, `on_the_go` and `photo_tourism`; `layouts` recognises which one reads a folder.
`images` reads photos, `dataset` brings them to the size of their cameras (`downscale`),
`photo_cache` holds as many as there is room for.
"""
