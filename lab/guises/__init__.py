"""The suite on other machines than this: `guises` says which variables make one machine look like
another, `__main__` runs the tests under them and writes docs/dev/machines.md.
"""
