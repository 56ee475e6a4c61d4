"""The package's own commands, one file each: options and printing only.

May import `pipeline`, `evaluation`, `survey`, `photo_tourism`, `datamanager`, `data`, `console` and
`errors`.
"""
