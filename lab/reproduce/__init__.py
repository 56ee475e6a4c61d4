"""Methods that `desplat` is compared with. It may import `lab.grid` and all of
`desplat_ns`.
"""
