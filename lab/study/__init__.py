"""One study of what separates static scene and distractors, light and sky, and of the survey's
decisions: `make study`. It may import all of `desplat_ns`, `lab.synthetic`, `lab.separation` and
`lab.reproduce`.
"""
