"""Gaussians as SPZ, version 3: a gzipped stream of quantized attributes, an eighth of a PLY.

Source: the format's description and reference implementation, nianticlabs/spz. Written here
because the packages that PyPI has fix the positions' precision, or drop the mark of antialiased
training. Letters in shapes: N Gaussians, K spherical-harmonics bases.
"""

import gzip
import math
import struct

import numpy as np
from jaxtyping import Bool, Float, UInt8, UInt32

from desplat_ns.core.errors import ConfigError
from desplat_ns.tools.export.splat_cloud import FAR, OFF_BY, SplatCloud

MAGIC, VERSION, ANTIALIASED = 0x5053474E, 3, 0x1
LARGEST = 2**23 - 1
"""Of a coordinate: 24 bits, signed."""
MAX_FRACTIONAL_BITS = 20
"""A millionth of a unit."""
COLOR_SCALE = 0.15
"""Of zeroth coefficients, so that colours somewhat beyond [0, 1] fit into a byte."""
SH_STEPS = (2, 4)
"""Of 128ths, for degree one and those above: 7 and 6 bits. The reference implementation's 5 and 4
make a file a third smaller and, where harmonics are small as in short runs, 33 dB of 50
(docs/results/quality.md); readers need not be told."""


def spz_bytes(cloud: SplatCloud) -> bytes:
    """The file.

    Largest errors: of a coordinate half a step, 2^-bits / 2 (see `fractional_bits`): the larger of
    2^-21 and 1.2e-7 (1 / LARGEST) of the largest coordinate. 1/32 of a scale's logarithm (between
    e^-10 and e^5.9), 1/510 of an opacity, 1/76 of a zeroth coefficient (within 3.3), 1/64 of the
    others (of degree one 1/128; within 1). How large that is beside Gaussians: see `placed`. Raises
    ConfigError where coordinates are too large for the format.
    """
    farthest = float(np.abs(cloud.means).max(initial=0.0))
    bits = fractional_bits(farthest)
    if bits < 0:
        raise ConfigError(
            f"A Gaussian lies {farthest:.3g} units from the origin; SPZ holds {LARGEST:.3g} at "
            "most. Leave out what is far away (--crop 2), or write .ply."
        )
    flags = ANTIALIASED if cloud.antialiased else 0
    header = struct.pack("<IIIBBBB", MAGIC, VERSION, len(cloud), cloud.degree, bits, flags, 0)
    attributes = (
        # 24-bit two's complement, least byte first
        np.rint(cloud.means * 2.0**bits).astype("<i4")[..., None].view(np.uint8)[..., :3],
        _bytes(cloud.opacities * 255),
        _zeroth(cloud),
        _bytes((np.log(cloud.scales) + 10) * 16),
        _smallest_three(np.roll(cloud.quats, -1, axis=1)),  # wxyz as xyzw
        _others(cloud),
    )
    stream = header + b"".join(part.tobytes() for part in attributes)
    return gzip.compress(stream, mtime=0)


def color_bytes(cloud: SplatCloud) -> UInt8[np.ndarray, " B"]:
    """The bytes of a file, unpacked, that depend on the light: zeroth coefficients of all
    Gaussians, then the others, as they follow one another there. B = 3 N K."""
    return np.concatenate([_zeroth(cloud).ravel(), _others(cloud).ravel()])


def placed(cloud: SplatCloud) -> tuple[Bool[np.ndarray, " N"], str]:
    """For which Gaussians a file has places that are precise enough, and what to tell a user, if
    there is something. Those beyond LARGEST / 2^bits are left out, at most a share `FAR` of all:
    one that floats far away would coarsen all the others. A place is rounded to a multiple of
    2^-bits, so it is off by 2^-bits / 2 at most: by `OFF_BY` of the cloud's `size` s, or less, from
    bits = ceil(log2(1 / (2 OFF_BY s))) on."""
    reach = np.abs(cloud.means).max(axis=1)
    needed = math.ceil(-math.log2(2 * OFF_BY * cloud.size))
    with_all = fractional_bits(reach.max())
    with_most = fractional_bits(np.quantile(reach, 1 - FAR, method="higher"))
    bits = max(with_all, min(needed, with_most))
    near = reach <= LARGEST / 2.0**bits
    step = 2.0 ** -fractional_bits(reach[near].max())
    if near.all() and step / 2 <= OFF_BY * cloud.size:
        return near, ""
    return near, (
        f"Not in the file: {(~near).sum()} of {len(cloud)} Gaussians, more than "
        f"{LARGEST / 2.0**bits:.3g} units from the origin. SPZ rounds the places of the others to "
        f"steps of {step:.3g} units, and Gaussians are as small as {cloud.size:.2g}. Write .ply, "
        "or leave out more of what is far away: --crop 2."
    )


def fractional_bits(coordinate: float) -> int:
    """Binary places beside which a coordinate has room; below 0 where it has none at all."""
    return min(MAX_FRACTIONAL_BITS, math.floor(math.log2(LARGEST / max(coordinate, 1.0))))


def _smallest_three(quats: Float[np.ndarray, "N 4"]) -> UInt32[np.ndarray, " N"]:
    """32 bits: which part of xyzw is largest in magnitude (2), then of the other three, in order, a
    sign and 9 bits of the magnitude, of which 511 is 1/sqrt(2). The largest counts as positive."""
    rows = np.arange(len(quats))
    largest = np.abs(quats).argmax(axis=1)
    positive = quats * np.where(quats[rows, largest] < 0, -1, 1)[:, None]
    others = np.arange(3) + (np.arange(3) >= largest[:, None])
    small = positive[rows[:, None], others]
    magnitude = np.rint(np.abs(small) * (511 * math.sqrt(2))).clip(0, 511).astype(np.uint32)
    fields = magnitude | (small < 0).astype(np.uint32) << 9
    packed = largest.astype(np.uint32)
    for i in range(3):
        packed = packed << 10 | fields[:, i]
    return packed.astype("<u4")


def _zeroth(cloud: SplatCloud) -> UInt8[np.ndarray, "N 3"]:
    return _bytes(cloud.harmonics[:, 0] * (COLOR_SCALE * 255) + 127.5)


def _others(cloud: SplatCloud) -> UInt8[np.ndarray, "N K 3"]:
    """128ths around 128, rounded to whole steps of `SH_STEPS`."""
    rest = cloud.harmonics[:, 1:]
    step = np.where(np.arange(rest.shape[1]) < 3, *SH_STEPS)[:, None]
    return (np.rint(rest * 128 / step) * step + 128).clip(0, 255).astype(np.uint8)


def _bytes(values: Float[np.ndarray, "*shape"]) -> UInt8[np.ndarray, "*shape"]:
    return np.rint(values).clip(0, 255).astype(np.uint8)
