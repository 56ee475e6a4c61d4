"""Files on disk: `whole` lets none be seen half-written and none be lost unasked.

May import `errors`.
"""
