"""The yardstick on the lists that gsplat 1.4 makes: every tile that the square of 3 sigma touches.

That is what a plain rasterizer usually starts from; the lists are half as long again as exact ones.
"""

from __future__ import annotations

from desplat_ns.backend.projection import project
from desplat_ns.backend.protocol import Rendering, RenderSettings, Splats, View
from lab.performance.yardstick import draw
from lab.pixels.contenders import Contender
from lab.pixels.square_lists import square_lists as tile_lists


class SquaresYardstick:
    """See `protocol.Rasterizer`; it has no absgrad, and cuts opaque Gaussians off at 3 sigma."""

    name = "yardstick, squares"

    def __call__(self, splats: Splats, view: View, settings: RenderSettings) -> Rendering:
        """Rasterize `splats` seen from `view`."""
        projected = project(splats, view, settings)
        lists = tile_lists(projected, view.width, view.height)
        return draw(projected, lists, view, settings)


SQUARES = Contender(SquaresYardstick.name, "cpu", SquaresYardstick(), seam="project")
"""Takes part in the timing of rasterizers only: its picture is another one."""
