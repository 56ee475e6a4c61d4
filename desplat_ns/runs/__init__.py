"""Trained runs on disk: `files` finds one without importing torch, `loading` takes it up."""
