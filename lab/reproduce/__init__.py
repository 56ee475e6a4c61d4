"""Methods that `desplat` is compared with. It may import `studies.grid` and `desplat_ns` outside of
`studies`.
"""
