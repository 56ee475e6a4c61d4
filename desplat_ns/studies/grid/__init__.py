"""Trainings that are compared: a variant of a method for some steps with a seed (`runs`), each in a
process of its own, on this machine or on Ray (`executors`). It may import `desplat_ns` outside of
`studies`, and no other study.
"""
