"""A trained run in the files of others: splats for viewers, masks for COLMAP and other trainers.

`splat_cloud` is what every format holds; `baked` takes it from a model, in the light that is
shown; `coordinates` moves it, `surroundings` crops it; `ply`, `spz` and `gltf` write it, `formats`
is their table. `masks` draws the training photos' distractor masks through each photo's `lens`;
`photos` says over which photo each lies. `export.export_splats` and
`export.export_masks` do the whole.

May import `runs`, `model`, `pipeline`, `datamanager`, `photo_tourism`, `gaussians`,
`rendering`, `data`, `backend`, `files`, `console` and `errors`.
"""
