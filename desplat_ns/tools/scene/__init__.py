"""The scene itself in a page: one HTML file in which somebody without anything can walk around.

`gather` takes from a run what is shown: the static Gaussians in the light of a few photos, the
cameras with their photos, what was taken out of them. `page` writes it, leaves out what shows least
where the page would get too large, and puts it around the modules of `script` and the libraries in
`viewer`, which `make viewer` builds (docs/dev/environment.md).
"""
