"""The scene itself in a page: one HTML file in which somebody without anything can walk around.

`gather` takes from a run what is shown (`contents`): the static Gaussians, the cameras with their
photos, what was taken out of them; `lights` chooses among the photos' lights. `reduction` leaves
out what shows least where a page would get too large; `page` writes it, around the modules of
`script` and the libraries in `viewer`, which `make viewer` builds (docs/dev/environment.md).
`scene.write_scene` is the one function.

May import `export`, `evaluation`, `runs`, `pipeline`, `datamanager`, `model`, `gaussians`,
`photo_tourism`, `rendering`, `data`, `backend`, `files`, `console` and `errors`.
"""
