"""What goes to the host and back arrives as it was, and the host waits once."""

from __future__ import annotations

import numpy as np
import torch

from desplat_ns.separation.transfers import masks_to_host, to_device, to_host


def test_masks_of_all_shapes_arrive_together_as_they_were():
    generator = torch.Generator().manual_seed(0)
    masks = [torch.rand(shape, generator=generator) > 0.5 for shape in ((7,), (3, 4), (0,), ())]
    found = masks_to_host(*masks)
    assert [one.shape for one in found] == [(7,), (3, 4), (0,), ()]
    for one, mask in zip(found, masks, strict=True):
        assert one.dtype == np.bool_
        assert np.array_equal(one, mask.numpy())


def test_there_and_back_again():
    values = torch.rand(3, 4, requires_grad=True)
    back = to_device(to_host(values), values.device)
    assert torch.equal(back, values.detach())
    assert not back.requires_grad
