"""Photos or a video to a capture with poses, for `desplat-process`, by pycolmap.

`sources` lists the photos and `workspace` keeps the record of what is done: a second call goes
on. `video`, `photos`, `preparation` and `cameras` prepare; `jobs` runs one stage in a process of
its own, where `features`, `matches` (of the `pairs` chosen), `mapping` and `undistortion` are all
that speaks to pycolmap. `recipes` has the numbers of the cheap and of the thorough way; `attempts`
goes them and says why photos were left out. `process.process` is the one function.

May import `data`, `files`, `console`, `cores` and `errors`.
"""
