"""Runs with a budget of time, as they were seen from outside."""

from __future__ import annotations

from dataclasses import dataclass

from desplat_ns.training.budget import seconds_of
from lab.documents import RECORDS

FILE = RECORDS / "budgets.json"
"""The records."""


@dataclass(frozen=True)
class Kept:
    """A run with a budget, as it was seen from outside."""

    scene: str
    budget: str
    beside: str
    """What else the machine was doing."""
    took: float
    """Seconds from the start of the command to its end."""
    planned: int
    """Steps, at the start."""
    done: int
    downscale: int
    """By how much photos were smaller in training."""

    def row(self) -> str:
        """Of the table."""
        photos = "whole" if self.downscale == 1 else f"1/{self.downscale}"
        share = self.took / seconds_of(self.budget)
        cells = (self.scene, self.beside, self.budget, f"{self.took:.0f} s ({share:.0%})")
        return "| " + " | ".join((*cells, f"{self.planned:,}", f"{self.done:,}", photos)) + " |"
