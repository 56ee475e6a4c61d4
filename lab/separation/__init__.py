"""How well static scene and distractors are told apart: docs/results/separation.md, `make study`.

It may import all of `desplat_ns`.
"""
