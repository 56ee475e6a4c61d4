"""Accuracy against time on one capture: trainings of several lengths and variants, and a page that
says what each is worth. It may import `studies.grid` and `desplat_ns` outside of `studies`.
"""
