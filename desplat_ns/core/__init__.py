"""What all rooms use: errors, the console, cores, options, steps and rates, and files on disk.

`whole` lets no file be seen half-written and none be lost unasked, and lets one process at a time
work in a folder; `checkpoint` and `run_files` find what a run left; `pages` has what HTML pages
share.
"""
