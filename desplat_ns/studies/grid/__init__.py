"""One grid for every study: settings by scenes by lengths by seeds, executed, recorded and tabled.
It may import `desplat_ns` outside of `studies`, and no other study.
"""
