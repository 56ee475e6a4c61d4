"""Trained runs on disk: `files` finds one without importing torch, `loading` takes it up
and chooses among its photos.

`trusted` refuses a config.yml that names what no run of ours names, before anything is made of it.

May import `run_config`, `pipeline` and `errors`.
"""
