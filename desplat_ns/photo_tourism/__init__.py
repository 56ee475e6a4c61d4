"""Photos of changing light: appearance and background models, embeddings, their data parser.

May import `training`, `rendering`, `data`, `backend`, `console`, `settings` and
`errors`.
"""
