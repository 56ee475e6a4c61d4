"""A trained run in the files of others: `export.export_splats` for viewers, by a `SplatCloud` that
`ply` or `spz` writes, `masks.export_masks` for COLMAP and other trainers."""
