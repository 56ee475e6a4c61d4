"""The published data sets, for `desplat-fetch-data`: where they lie (`sources`), downloads that go
on where they ended (`download`). `fetch.fetch` is the one function.
"""
