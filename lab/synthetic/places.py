"""The places that can be drawn: what stands there, where cameras stand, where points are found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from lab.synthetic import facade, grove, room, table, yard
from lab.synthetic.cameras import IN_THE_YARD, Stand
from lab.synthetic.points import BARE, BARE_INDOORS
from lab.synthetic.primitives import Primitive


@dataclass(frozen=True)
class Place:
    """One kind of static scene."""

    things: Callable[[], list[Primitive]]
    """What casts shadows."""
    around: Callable[[float], list[Primitive]]
    """What is around it, with walls of a height in metres where the place has walls."""
    stand: Stand = IN_THE_YARD
    bare: float | None = BARE
    """See `sample_pixels`."""


PLACES = {
    "yard": Place(yard.furniture, yard.walls_and_ground),
    "room": Place(room.glossy_things, room.walls_and_floor, bare=BARE_INDOORS),
    "grove": Place(grove.trees, lambda _: grove.ground()),
    "facade": Place(
        facade.house_and_trees, lambda _: facade.lawn_and_path(), facade.STAND, bare=None
    ),
    "table": Place(table.table_and_toy, lambda _: table.room_behind(), table.STAND, bare=None),
}
"""To add a place, write its lists of solids and name it here."""
