"""Which dtype the appearance MLP's products have, and whether this machine is made for it."""

from __future__ import annotations

import os
from functools import cache
from typing import Literal

import torch
from torch import Tensor

from desplat_ns.errors import ConfigError

MlpDtype = Literal["float32", "bfloat16"]

WITHOUT_BFLOAT16 = ("SSE41", "AVX", "AVX2", "AVX2_VNNI", "AVX512_CORE", "AVX512_CORE_VNNI")
"""Values of ONEDNN_MAX_CPU_ISA by which oneDNN, which multiplies for torch, leaves the
instructions for bfloat16 alone."""


def product_dtype(asked: MlpDtype, inputs: Tensor, is_training: bool) -> torch.dtype:
    """The dtype asked for; where none was, that of the inputs.

    What was trained in bfloat16 is drawn in bfloat16 everywhere: torch rounds alike without the
    instructions, only slowly.

    Raises:
        ConfigError: bfloat16 is to train on a device without instructions for it.
    """
    if asked == "float32":
        return inputs.dtype
    if is_training and not has_bfloat16(inputs.device.type):
        device = "GPU" if inputs.is_cuda else "processor"
        raise ConfigError(
            f"`--pipeline.model.appearance.mlp-dtype` is bfloat16, and this {device} has no "
            "instructions for it (a CPU needs avx512_bf16 or AMX): training would be slower than "
            "in float32. Leave the option out."
        )
    return torch.bfloat16


@cache
def has_bfloat16(device_type: str) -> bool:
    """Whether products of bfloat16 have instructions of their own on this kind of device."""
    if device_type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    if device_type != "cpu" or os.environ.get("ONEDNN_MAX_CPU_ISA") in WITHOUT_BFLOAT16:
        return False
    tests = ("_is_avx512_bf16_supported", "_is_amx_tile_supported")  # torch 2.4 and later
    return any(getattr(torch.cpu, name, lambda: False)() for name in tests)
