"""What a rasterizer may draw more or less exactly, and how each dial is turned.

All limits are numbers that the backends read from their modules' globals, and give to compiled
kernels as arguments: with other numbers there the same code draws another picture, and nothing is
compiled anew. The globals are the whole process's: nothing else may draw meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from types import ModuleType
from typing import Any, Literal
from unittest import mock

import numpy as np
import torch

from desplat_ns.backend import blending, numba_tiles, projection, tile_lists, torch_tiles
from desplat_ns.backend.constants import ALPHA_CUTOFF, ALPHA_MAX, TRANSMITTANCE_MIN
from desplat_ns.backend.numba_kernels.pixels import Limits
from desplat_ns.calibration.scenes import SH_DEGREE
from lab.pixels.contenders import Contender
from lab.pixels.square_lists import CompiledSquareLists, square_lists

LEAST_ALPHA, LEAST_TRANSMITTANCE = 1e-6, 1e-7
"""Limits that stand for none. Gaussians of total area A = sum(2 pi sigma^2) over a pixel lose A
times the cutoff there, whatever their opacity: A is about 12 pixels in a generated scene, and a few
of them are not yet hidden, so that this cutoff costs 1e-6 to 1e-5 of a colour. That is a thousandth
of what today's costs, and what float32 rounds away. A lower one makes lists longer: their area
grows with the cutoff's logarithm, here to 2.5 times today's."""


@dataclass(frozen=True)
class Setting:
    """One position of all dials; today's where nothing is said."""

    dtype: torch.dtype = torch.float32
    lists: Literal["exact", "squares"] = "exact"
    """Gaussians are listed where they reach the cutoff, or in their 3-sigma squares (gsplat's):
    then what an opaque one shows beyond is drawn in the squares' tiles only."""
    cutoff: float = ALPHA_CUTOFF
    stop: float = TRANSMITTANCE_MIN
    antialiased: bool = False
    sh_degree: int = SH_DEGREE
    """Evaluated; all coefficients are carried along, as in training while the degree grows."""
    scale: float = 1.0
    """Of the picture's width and height."""


TODAY = Setting()

EXACT = Setting(torch.float64, cutoff=LEAST_ALPHA, stop=LEAST_TRANSMITTANCE)

SUPERSAMPLED = Setting(cutoff=LEAST_ALPHA, stop=LEAST_TRANSMITTANCE, antialiased=True, scale=4.0)
"""For the mean over 4 x 4 samples in each pixel. With more samples both ways of antialiasing come
to the same; with these, opacities that make up for the low-pass are nearer to it."""


@dataclass(frozen=True)
class Position:
    """One dial away from today's setting."""

    dial: str
    value: str
    setting: Setting


DIALS = (
    Position("dtype", "float64", Setting(torch.float64)),
    Position("tile lists", "3-sigma squares", Setting(lists="squares")),
    Position("alpha cutoff", "1/32", Setting(cutoff=1 / 32)),
    Position("alpha cutoff", "1/64", Setting(cutoff=1 / 64)),
    Position("alpha cutoff", "1/1024", Setting(cutoff=1 / 1024)),
    Position("early stop", "1e-2", Setting(stop=1e-2)),
    Position("early stop", "1e-3", Setting(stop=1e-3)),
    Position("early stop", "1e-7", Setting(stop=LEAST_TRANSMITTANCE)),
    Position(
        "cutoff and stop",
        "1e-6, 1e-7",
        Setting(cutoff=LEAST_ALPHA, stop=LEAST_TRANSMITTANCE),
    ),
    Position("SH degree", "0", Setting(sh_degree=0)),
    Position("SH degree", "1", Setting(sh_degree=1)),
    Position("SH degree", "2", Setting(sh_degree=2)),
    Position("resolution", "1/2", Setting(scale=1 / 2)),
    Position("resolution", "1/4", Setting(scale=1 / 4)),
)

ANTIALIASED = Position("antialiasing", "on", Setting(antialiased=True))

Replacement = tuple[ModuleType, str, Any]


def unavailable_reason(contender: Contender, setting: Setting) -> str | None:
    """Why a contender cannot draw with a setting; None where it can."""
    if setting.dtype != torch.float32 and contender.name != "torch":
        return f"{contender.name} computes in float32"
    limits = (setting.lists, setting.cutoff, setting.stop)
    if limits != (TODAY.lists, TODAY.cutoff, TODAY.stop) and contender.name not in _LIMITS_OF:
        return f"{contender.name} has lists and limits of its own, compiled in"
    return None


def replacements(contender: Contender, setting: Setting) -> list[Replacement]:
    """Which globals a setting needs, and their values; to be made once for a scene.

    The lists of squares are kept from one call to the next: see `CompiledSquareLists`.
    """
    if contender.name not in _LIMITS_OF:
        return []
    reach = math.sqrt(2 * math.log(1 / setting.cutoff))
    return [(projection, "REACH_SIGMAS", reach), *_LIMITS_OF[contender.name](setting)]


def _limits_of_torch(setting: Setting) -> list[Replacement]:
    changes: list[Replacement] = [
        (blending, "ALPHA_CUTOFF", setting.cutoff),
        (tile_lists, "ALPHA_CUTOFF", setting.cutoff),
        (blending, "TRANSMITTANCE_MIN", setting.stop),
        (torch_tiles, "TRANSMITTANCE_MIN", setting.stop),
    ]
    if setting.lists == "squares":
        changes.append((torch_tiles, "tile_lists", square_lists))
    return changes


def _limits_of_numba(setting: Setting) -> list[Replacement]:
    limits = Limits(np.float32(ALPHA_MAX), np.float32(setting.cutoff), np.float32(setting.stop))
    changes: list[Replacement] = [
        (numba_tiles, "ALPHA_CUTOFF", setting.cutoff),
        (numba_tiles, "_LIMITS", limits),
    ]
    if setting.lists == "squares":
        changes.append((numba_tiles, "tile_lists", CompiledSquareLists()))
    return changes


_LIMITS_OF = {"numba": _limits_of_numba, "torch": _limits_of_torch}
"""Backends whose limits can be turned."""


@contextmanager
def turned(changes: list[Replacement]) -> Iterator[None]:
    """Within, the globals have the values of `replacements`; after it, whatever happened, their
    own. A backward pass reads them again: it belongs within as well."""
    with ExitStack() as stack:
        for module, name, value in changes:
            stack.enter_context(mock.patch.object(module, name, value))
        yield
