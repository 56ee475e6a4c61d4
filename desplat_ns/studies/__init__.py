"""Runs that answer a question: how well told apart, how exact, how fast. They work without a
checkout and may import all of `desplat_ns`, which imports nothing from here.
"""
