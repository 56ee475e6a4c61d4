"""Recognises how a capture lies on disk and takes the dataparser that reads it."""
