"""Trained runs on disk: `files` finds one without importing torch, `loading` takes it up, from a
config.yml that names nothing foreign, and chooses among its photos.
"""
