"""One kind of parameter of every training view, and which views a step drew."""

from __future__ import annotations

from collections.abc import Iterable

from torch import nn


class ParametersOfViews(list[nn.Parameter]):
    """As an optimizer group is given it.

    A step draws one view of what may be thousands: whoever looks for gradients need not ask all.
    """

    def __init__(self, parameters: Iterable[nn.Parameter], drawn: list[int]):
        """Args:
        parameters: by training view.
        drawn: the views of which there may be gradients, as training goes on.
        """
        super().__init__(parameters)
        self.drawn = drawn
