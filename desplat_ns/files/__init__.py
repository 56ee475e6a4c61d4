"""Files on disk: `whole` lets none be seen half-written and none be lost unasked, `lock`
lets one process at a time work on them, `pages` has what HTML pages share.

May import `errors`.
"""
