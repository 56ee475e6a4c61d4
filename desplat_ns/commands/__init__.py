"""The package's own commands, one file each: options and printing only.

May import `method_configs`, `calibration`, `pipeline`, `static_model`, `evaluation`, `survey`,
`photo_tourism`, `layouts`, `datamanager`, `studies`, `report`, `export`, `process`, `training`,
`data`, `effects`, `options`, `console` and `errors`.
"""
