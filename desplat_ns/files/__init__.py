"""Files on disk: `whole` lets none be seen half-written and none be lost unasked, and lets one
process at a time work in a folder; `pages` has what HTML pages share, and makes their pictures as
small as they have to be.
"""
