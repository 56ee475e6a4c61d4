"""Files on disk: `whole` lets none be seen half-written and none be lost unasked, `lock`
lets one process at a time work on them, `pages` has what HTML pages share, and `encoding` makes
their pictures as small as they need them.

May import `errors`.
"""
