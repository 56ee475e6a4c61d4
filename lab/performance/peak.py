"""How many float32 operations a core can do at most: fused multiply-adds, all in registers."""

from __future__ import annotations

import time
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = (4, 8, 16)
"""Numbers in a register of 128, 256 and 512 bits; what a processor lacks is done in parts."""

CHAINS = 12
"""Independent sums: more than a multiply-add's latency (4 cycles) times the units (2) that work
side by side, and few enough for 16 registers."""

FLOPS_FORWARD = 30
"""Per (pixel, Gaussian) pair. A convention that is kept so that figures can be compared over time:
comparisons, minima, selections and the Gaussian's own preparation count nothing. The kernel of the
`numba` backend does 37 by the same rules: offset 2, quadratic form 9, exp 14, opacity 1,
transmittance 2, weight 1, four features 8."""

FLOPS_BACKWARD = 54
"""The kernel does 67: offset, form, exp and opacity again 26; dL/dweight from four features 8;
1 - alpha, its inverse, transmittance and weight 4; dL/dsigma and the running sum 6; sums for mean,
conic, opacity and absgrad 15; sums for four features 8. Times 30 / 37, as in the forward pass."""


def _make_chains(lanes: int) -> Any:
    """An intrinsic: `steps` rounds of CHAINS multiply-adds of vectors; returns one number."""

    @intrinsic
    def chains(typingctx, steps, factor):
        def codegen(context, builder, signature, args):
            vector = ir.VectorType(ir.FloatType(), lanes)
            steps, factor = args
            factors = _spread(builder, factor, vector)
            fma = cgutils.get_or_insert_function(
                builder.module,
                ir.FunctionType(vector, [vector] * 3),
                f"llvm.fma.v{lanes}f32",
            )
            entry = builder.block
            loop, end = builder.append_basic_block("loop"), builder.append_basic_block("end")
            builder.branch(loop)
            builder.position_at_end(loop)
            step = builder.phi(steps.type)
            step.add_incoming(ir.Constant(steps.type, 0), entry)
            sums = [builder.phi(vector) for _ in range(CHAINS)]
            for k, total in enumerate(sums):
                total.add_incoming(ir.Constant(vector, [0.5 + k] * lanes), entry)
                total.add_incoming(builder.call(fma, [total, factors, factors]), loop)
            following = builder.add(step, ir.Constant(steps.type, 1))
            step.add_incoming(following, loop)
            builder.cbranch(builder.icmp_signed("<", following, steps), loop, end)
            builder.position_at_end(end)
            return _sum_up(builder, sums, lanes)

        return types.float32(types.int64, types.float32), codegen

    return chains


def _spread(builder: ir.IRBuilder, value: ir.Value, vector: ir.VectorType) -> ir.Value:
    """The same number in all lanes."""
    filled: Any = ir.Constant(vector, ir.Undefined)
    for lane in range(vector.count):
        place = ir.Constant(ir.IntType(32), lane)
        filled = builder.insert_element(filled, value, place)
    return filled


def _sum_up(builder: ir.IRBuilder, sums: list, lanes: int) -> ir.Value:
    """All lanes of all chains in one number, so that none of the work can be left out."""
    whole = sums[0]
    for part in sums[1:]:
        whole = builder.fadd(whole, part)
    total: Any = ir.Constant(ir.FloatType(), 0.0)
    for lane in range(lanes):
        part = builder.extract_element(whole, ir.Constant(ir.IntType(32), lane))
        total = builder.fadd(total, part)
    return total


def fma_rate(lanes: int, seconds: float = 0.2) -> float:
    """GFLOP/s of one core with vectors of `lanes` float32, the best of several attempts.

    A multiply-add counts as two operations.
    """
    chains = _make_chains(lanes)

    @numba.njit
    def work(steps, factor):
        return chains(steps, factor)

    factor, steps, best = np.float32(0.5), 200_000, 0.0
    work(steps, factor)
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        before = time.perf_counter()
        work(steps, factor)
        elapsed = time.perf_counter() - before
        best = max(best, 2 * lanes * CHAINS * steps / elapsed)
    return best / 1e9


def peak_rates(seconds: float = 0.2) -> dict[int, float]:
    """GFLOP/s of one core by the width of the vectors in bits."""
    return {32 * lanes: fma_rate(lanes, seconds) for lanes in LANES}
