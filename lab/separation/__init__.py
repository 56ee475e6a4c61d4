"""How well static scene and distractors are told apart: real passers-by, hard cases, pictures.

It may import all of `desplat_ns`.
"""
