"""Looks at a capture before training and says which effects it calls for, with the evidence.

May import `data`, `console`, `cores`, `settings` and `errors`.
"""
