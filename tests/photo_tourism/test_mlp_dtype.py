"""bfloat16 is taken where it was asked for, and refused in training where it would be slow."""

from __future__ import annotations

import pytest
import torch

from desplat_ns.errors import ConfigError
from desplat_ns.photo_tourism import mlp_dtype
from desplat_ns.photo_tourism.mlp_dtype import has_bfloat16, product_dtype


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_by_default_products_have_the_dtype_of_the_inputs(dtype):
    assert product_dtype("float32", torch.zeros(1, dtype=dtype), True) == dtype


@pytest.mark.parametrize(("is_training", "has"), [(True, True), (False, True), (False, False)])
def test_bfloat16_where_it_was_asked_for(monkeypatch, is_training, has):
    monkeypatch.setattr(mlp_dtype, "has_bfloat16", lambda device: has)
    assert product_dtype("bfloat16", torch.zeros(1), is_training) == torch.bfloat16


def test_training_without_the_instructions_is_refused(monkeypatch):
    monkeypatch.setattr(mlp_dtype, "has_bfloat16", lambda device: False)
    with pytest.raises(ConfigError, match=r"mlp-dtype` is bfloat16.*Leave the option out"):
        product_dtype("bfloat16", torch.zeros(1), True)


def test_no_other_device_is_taken_to_have_them():
    assert not has_bfloat16("meta")


def test_what_onednn_may_not_use_is_not_there(monkeypatch):
    """Whatever the processor has."""
    has_bfloat16.cache_clear()
    monkeypatch.setenv("ONEDNN_MAX_CPU_ISA", "AVX2")
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: True)
    assert not has_bfloat16("cpu")
    has_bfloat16.cache_clear()
    monkeypatch.delenv("ONEDNN_MAX_CPU_ISA")
    assert has_bfloat16("cpu")
    has_bfloat16.cache_clear()
