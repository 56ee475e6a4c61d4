"""A trained run in the files of others: splats for viewers, masks for COLMAP and other trainers.

`splat_cloud` takes from a model what every format holds, in the light that is shown, and moves it
to the file's coordinates; `ply`, `spz` and `gltf` write it, `formats` is their table. `masks` draws
the training photos' distractor masks through each photo's lens. `export.export_splats` and
`export.export_masks` do the whole.
"""
