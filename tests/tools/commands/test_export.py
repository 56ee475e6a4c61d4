"""desplat-export on a tiny run: files are whole; mistakes are told at once and leave nothing."""

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from nerfstudio.scripts import train
from PIL import Image

from desplat_ns.core.errors import CaptureError, ConfigError
from desplat_ns.tools.commands.export import Masks, Page, Splats
from desplat_ns.tools.commands.report import Report
from tests.helpers.splat_files import read_splats


@pytest.mark.parametrize("frame", ["upright", "training"])
def test_every_format_holds_the_same_gaussians(trained: Path, tmp_path: Path, frame: Any):
    """Within 128 units SPZ has places in steps of 2^-16 or finer."""
    for name in ("a.ply", "a.spz"):
        Splats(trained, output=tmp_path / name, frame=frame).main()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.ply", "a.spz"]
    ply, spz = (read_splats((tmp_path / f"a.{kind}").read_bytes(), kind) for kind in ("ply", "spz"))
    up = np.array([1, 1, 1] if frame == "training" else [1, -1, -1])  # a PLY has its y down
    assert np.allclose(ply.means * up, spz.means, atol=2.0**-16)
    assert (tmp_path / "a.spz").stat().st_size < (tmp_path / "a.ply").stat().st_size / 4


def test_splats_need_nothing_of_the_capture_and_all_else_names_where_it_was(
    trained: Path, tmp_path: Path
):
    moved = Path(shutil.copytree(trained.parent, tmp_path / "moved"))
    (moved / "config.yml").write_text(trained.read_text().replace("tiny_scene", "gone_scene"))
    for config, name in ((trained, "there.ply"), (moved / "config.yml", "gone.ply")):
        Splats(config, output=tmp_path / name, frame="capture").main()
    assert (tmp_path / "gone.ply").read_bytes() == (tmp_path / "there.ply").read_bytes()
    with pytest.raises(CaptureError, match=r"gone_scene.*--data"):
        Masks(moved / "config.yml", output=tmp_path / "masks").main()


def test_a_crop_leaves_out_what_is_far_and_says_so(trained: Path, tmp_path: Path, capsys):
    counts = []
    for crop in (None, 1.0, 1e6):
        Splats(trained, output=tmp_path / f"{crop}.ply", crop=crop).main()
        counts.append(len(read_splats((tmp_path / f"{crop}.ply").read_bytes(), "ply")))
    assert 0 < counts[1] < counts[0] == counts[2]
    assert f"leaves out {counts[0] - counts[1]}" in capsys.readouterr().out
    with pytest.raises(ConfigError, match="--crop"):
        Splats(trained, output=tmp_path / "none.ply", crop=1e-6).main()
    assert not (tmp_path / "none.ply").exists()


def test_every_training_photo_has_a_mask_of_its_size(
    trained: Path, tmp_path: Path, tiny_scene, monkeypatch: pytest.MonkeyPatch
):
    """Distractors are faint after so few steps: anything that is there counts."""
    monkeypatch.setattr("desplat_ns.tools.export.masks.MASK_THRESHOLD", 0.05)
    Masks(trained, output=tmp_path / "a").main()
    Masks(trained, output=tmp_path / "b", invert=True, dilate=2.0, names="nerfstudio").main()
    used = sorted((tmp_path / "a").iterdir())
    masked = sorted((tmp_path / "b").iterdir())
    assert len(used) == len(masked) == 6
    some = False
    for mask, other in zip(used, masked, strict=True):
        photo = tiny_scene.folder / "images" / mask.name.removesuffix(".png")
        assert other.name == f"{photo.stem}.png"
        black, white = (np.asarray(Image.open(path)) for path in (mask, other))
        assert black.shape == Image.open(photo).size[::-1] == white.shape
        assert black.dtype == np.uint8 and set(np.unique(black)) <= {0, 255}
        assert (white[black == 0] == 255).all(), "a grown mask holds the mask"
        some |= bool((black == 0).any() and (white == 255).sum() > (black == 0).sum())
    assert some, "something is masked, and grows"


def test_masks_for_training_are_corrected_and_taken_back(
    trained: Path, tmp_path: Path, tiny_run, tiny_scene
):
    with pytest.raises(ConfigError, match="--invert"):
        Masks(trained, output=tmp_path / "masks", for_training=True, invert=True).main()
    Masks(trained, output=tmp_path / "masks", for_training=True).main()
    config: Any = tiny_run(tmp_path / "runs")
    config.max_num_iterations = 2
    parser = config.pipeline.datamanager.dataparser
    parser.masks_path = tmp_path / "masks"  # a folder below the capture, or a whole path
    manager = config.pipeline.datamanager.setup(device="cpu", test_mode="val")
    first, held_out = manager.train_dataset, manager.eval_dataset
    photo = first.image_filenames[0].name
    before, painted = first.get_data(0)["mask"].numpy(), tmp_path / "masks" / f"{photo}.png"
    mask = np.array(Image.open(painted))
    mask[4:12, 6:20] = 0
    Image.fromarray(mask).save(painted)
    after = first.get_data(0)["mask"].numpy()
    assert before[4:12, 6:20].any() and not after[4:12, 6:20].any()
    assert (after == before)[12:].all() and held_out.get_data(0)["mask"].all()
    train.main(config)
    Masks(config.get_base_dir() / "config.yml", output=tmp_path / "b", for_training=True).main()
    assert sorted(path.name for path in (tmp_path / "b").iterdir()) == sorted(
        f"{path.name}.png" for path in (tiny_scene.folder / "images").iterdir()
    )
    again = np.array(Image.open(tmp_path / "b" / painted.name))
    assert not again[mask == 0].any() and again[mask > 0].any()


def test_a_run_without_distractors_has_no_masks_and_is_reported_without(tiny_run, tmp_path: Path):
    config: Any = tiny_run(tmp_path / "runs")
    config.max_num_iterations = 2
    config.pipeline.model.effects.distractors = False
    train.main(config)
    run, page = config.get_base_dir() / "config.yml", tmp_path / "page.html"
    with pytest.raises(ConfigError, match="distractors"):
        Masks(run, output=tmp_path / "masks").main()
    assert not (tmp_path / "masks").exists()
    Report(run, output=page, held_out_photos=0, scene=False).main()
    alts = re.findall(r'<img[^>]* alt="[^"]*, ([^"]*)"', page.read_text("utf8"))
    assert set(alts) == {"the photo", "the static scene"}


def test_a_page_is_whole_and_not_replaced_unasked(trained: Path, tmp_path: Path, capsys):
    Page(trained, output=tmp_path / "a.html", training_photos=2).main()
    said = " ".join(capsys.readouterr().out.split())
    size = (tmp_path / "a.html").stat().st_size
    assert f"a page with the scene in it, {size / 1e6:.1f} MB" in said
    assert "2 of 6 training photos" in said
    assert [path.name for path in tmp_path.iterdir()] == ["a.html"]
    with pytest.raises(ConfigError, match="--overwrite"):
        Page(trained, output=tmp_path / "a.html").main()
