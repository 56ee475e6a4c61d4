"""Photos or a video to a capture with poses, for `desplat-process`, by pycolmap.

`request` has the options and finds the photos. `process.process` is the one function: it goes on
with what is in the work folder, and says what came out. `video` and `photos` give copies, masks
and groups of photos of one camera. pycolmap does the rest: `reconstruction` (features, pairs,
matches, poses) and `undistortion`.
"""
