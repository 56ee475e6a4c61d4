"""Photos or a video to a capture with poses, for `desplat-process`: `request` has the options and
finds the photos, `process.process` does all, by `photos`, `video` and, with pycolmap,
`reconstruction` (features, pairs, matches, poses) and `undistortion`."""
