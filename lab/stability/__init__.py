"""Hard cases, wrong signs, kills and a long run: docs/dev/stability.md, `make stability`. It may
import all of `desplat_ns`, and what the tests share.
"""
