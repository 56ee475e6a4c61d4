"""The scene in one HTML file, to walk around in, `page.write_scene`: what `gather` takes from a
run, `script`, and the libraries in `viewer`, by `make viewer` (docs/dev/environment.md)."""
