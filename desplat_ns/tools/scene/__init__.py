"""The scene itself in one HTML file, to walk around in, `page.write_scene`: what `gather` takes
from a run around the modules of `script` and the libraries in `viewer`, which `make viewer` builds
(docs/dev/environment.md)."""
