"""Captures, real, altered and generated, and how often the survey decides rightly on them. It may
import all of `desplat_ns`, `lab.synthetic` and `lab.separation`.
"""
