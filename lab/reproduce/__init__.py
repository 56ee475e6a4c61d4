"""Methods that `desplat` is compared with, and the data sets of the paper's tables in small. It may
import `lab.synthetic` and all of `desplat_ns`.
"""
