"""What `desplat` is compared with."""

from pathlib import Path
from typing import Any

import pytest
import torch
from nerfstudio.plugins.types import MethodSpecification

from desplat_ns.core.errors import CaptureError
from desplat_ns.data.colmap import GT_MASKS
from desplat_ns.tools.studies.methods import parse
from lab.reproduce.baselines import (
    TRIMMED_SHARE,
    _trimmed,
    by_residual,
    by_truth,
    mask_of,
    shadow_mask_of,
)

EFFECTS = "--pipeline.model.effects"
OFF = (f"{EFFECTS}.auto", "False", f"{EFFECTS}.distractors", "False")


@pytest.mark.usefixtures("tyro_may_build")
@pytest.mark.parametrize("method", [by_truth, by_residual])
def test_they_differ_from_plain_splatfacto_in_nothing_but_the_loss(method: MethodSpecification):
    off: Any = parse("desplat", [*OFF, "--pipeline.model.opacity-prior", "0"])
    baseline: Any = method.config
    plain, masked = vars(off.pipeline.model), vars(baseline.pipeline.model)
    apart = {option for option in masked if plain.get(option) != masked[option]}
    assert apart == {"_target", "by_truth"} and masked["by_truth"] is (method is by_truth)
    assert off.optimizers == baseline.optimizers


@pytest.mark.parametrize(
    ("masks", "names"),
    [([Path("a.png"), None], ["a.jpg", "b.jpg"]), (None, ["clean_1.jpg", "clutter_2.jpg"])],
)
def test_a_photo_without_a_mask_is_named_unless_its_name_says_that_it_is_clean(masks, names):
    metadata = {GT_MASKS: masks, "train_image_names": names}
    assert mask_of(metadata, 0) == (masks[0] if masks else None)
    with pytest.raises(CaptureError, match=names[1]):
        mask_of(metadata, 1)


def test_a_trimmed_loss_leaves_out_the_largest_residuals():
    rendered, photo = torch.zeros(20, 20, 3), torch.rand(20, 20, 3) * 0.1
    photo[5:12, 5:12] = 1.0
    left_out = _trimmed(rendered, photo)[..., 0]
    assert left_out[6:11, 6:11].all()
    assert left_out.float().mean() < 1 - TRIMMED_SHARE


def test_shadows_lie_beside_their_masks_in_folders_of_folders_too(tmp_path: Path):
    for name in ("masks/a", "shadow_masks/a"):
        (tmp_path / name).mkdir(parents=True)
    mask = tmp_path / "masks/a/0.png"
    assert shadow_mask_of(mask) is None
    shadows = tmp_path / "shadow_masks/a/0.png"
    shadows.touch()
    assert shadow_mask_of(mask) == shadows
    assert shadow_mask_of(tmp_path / "masks/0.png") is None
