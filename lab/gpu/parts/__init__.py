"""One file for each part: `measure(job)` yields its figures. Their tables: `gpu.tables`.

They are imported in the part's own process only.
"""
