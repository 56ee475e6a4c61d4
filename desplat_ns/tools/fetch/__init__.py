"""The published data sets, for `desplat-fetch-data`: where they lie, and `fetch.fetch`."""
