"""desplat-export on a tiny run: files are whole; mistakes are told at once and leave nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from desplat_ns.errors import ConfigError
from tests.helpers.glb_reader import read_glb
from tests.helpers.quick_command import check_quick_command
from tests.helpers.splat_readers import read_splats

TRAINING_PHOTOS = 6


@pytest.mark.slow
@pytest.mark.parametrize("frame", ["upright", "training"])
def test_every_format_holds_the_same_gaussians(trained: Path, tmp_path: Path, frame: Any):
    from plyfile import PlyData

    from desplat_ns.commands.export import Splats

    for name in ("a.ply", "a.glb", "a.spz"):
        Splats(trained, tmp_path / name, frame).main()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.glb", "a.ply", "a.spz"]
    table = PlyData.read(tmp_path / "a.ply")["vertex"].data
    x, y, z = (table[name] for name in "xyz")
    points = read_glb((tmp_path / "a.glb").read_bytes())[1]["POSITION"]
    up = (x, y, z) if frame == "training" else (x, -y, -z)  # a PLY has its y down
    assert np.allclose(np.stack(up, axis=1), points, atol=1e-6)
    assert (tmp_path / "a.spz").stat().st_size < (tmp_path / "a.ply").stat().st_size / 4


@pytest.mark.slow
def test_gaussians_lie_over_the_points_of_the_capture(trained: Path, tmp_path: Path, tiny_scene):
    """The reconstruction's points are where training began, and it was short."""
    from plyfile import PlyData

    from desplat_ns.commands.export import Splats
    from desplat_ns.data.reconstruction import read_reconstruction

    Splats(trained, tmp_path / "a.ply", "capture").main()
    table = PlyData.read(tmp_path / "a.ply")["vertex"].data
    means = np.stack([table[name] for name in "xyz"], axis=1)
    points = read_reconstruction(tiny_scene.folder, Path("sparse")).points.xyz
    nearest = np.linalg.norm(points[:, None] - means, axis=2).min(1)
    extent = np.linalg.norm(points.max(0) - points.min(0))
    assert np.median(nearest) < 0.01 * extent


@pytest.mark.slow
def test_a_crop_leaves_out_what_is_far_and_says_so(trained: Path, tmp_path: Path, capsys):
    from desplat_ns.commands.export import Splats

    counts = []
    for crop in (None, 1.0, 1e6):
        Splats(trained, tmp_path / f"{crop}.glb", crop=crop).main()
        counts.append(len(read_glb((tmp_path / f"{crop}.glb").read_bytes())[1]["POSITION"]))
    assert 0 < counts[1] < counts[0] == counts[2]
    assert f"leaves out {counts[0] - counts[1]}" in capsys.readouterr().out
    with pytest.raises(ConfigError, match=r"--crop 1e-06 leaves none of"):
        Splats(trained, tmp_path / "none.glb", crop=1e-6).main()
    assert not (tmp_path / "none.glb").exists()


@pytest.mark.slow
def test_what_no_allowed_view_shows_is_left_out_and_told(
    trained: Path, tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
):
    from desplat_ns.commands.export import Splats
    from desplat_ns.model import DeSplatModel

    def with_one_overhead(model: DeSplatModel) -> Any:
        splats = shown_splats(model)
        overhead = torch.tensor([[0.0, 0.0, 1000.0]])
        return replace(splats, means=torch.cat([overhead, splats.means[1:]]))

    shown_splats = DeSplatModel.shown_splats
    counts = []
    for _ in range(2):
        Splats(trained, tmp_path / f"{len(counts)}.glb", "training").main()
        places = read_glb((tmp_path / f"{len(counts)}.glb").read_bytes())[1]["POSITION"]
        counts.append(len(places))
        assert places.max() < 100
        monkeypatch.setattr(DeSplatModel, "shown_splats", with_one_overhead)
    assert counts[1] == counts[0] - 1
    assert "1 are left out that no training camera shows" in capsys.readouterr().out


@pytest.mark.slow
def test_places_in_an_spz_are_as_precise_with_a_gaussian_far_away_as_without(
    trained: Path, tmp_path: Path, capsys, monkeypatch: pytest.MonkeyPatch
):
    """It is left out, and told; a .glb has it."""
    from desplat_ns.commands.export import Splats
    from desplat_ns.export import export

    def with_a_far_one(splats: Any, antialiased: bool) -> Any:
        cloud = baked(splats, antialiased)
        cloud.means[0] = 1e6
        return cloud

    baked = export.baked
    Splats(trained, tmp_path / "before.spz", "training").main()
    capsys.readouterr()
    monkeypatch.setattr(export, "baked", with_a_far_one)
    for name in ("a.spz", "a.glb"):
        Splats(trained, tmp_path / name, "training").main()
    before, after = (
        read_splats((tmp_path / n).read_bytes()).means for n in ("before.spz", "a.spz")
    )
    assert np.array_equal(after, before[1:])
    said = capsys.readouterr().out
    assert f"Not in the file: 1 of {len(before)} Gaussians" in said
    assert f"SPZ, {len(after)} Gaussians" in said
    whole = read_glb((tmp_path / "a.glb").read_bytes())[1]["POSITION"]
    assert len(whole) == len(before) and whole.max() == 1e6


@pytest.mark.slow
def test_every_training_photo_has_a_mask_of_its_size(
    trained: Path, tmp_path: Path, tiny_scene, monkeypatch: pytest.MonkeyPatch
):
    """Distractors are faint after so few steps: anything that is there counts."""
    from desplat_ns.commands.export import Masks

    monkeypatch.setattr("desplat_ns.export.masks.MASK_THRESHOLD", 0.05)
    Masks(trained, tmp_path / "a").main()
    Masks(trained, tmp_path / "b", invert=True, dilate=2.0, names="nerfstudio").main()
    used = sorted((tmp_path / "a").iterdir())
    masked = sorted((tmp_path / "b").iterdir())
    assert len(used) == len(masked) == TRAINING_PHOTOS
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


@pytest.mark.slow
def test_a_run_without_distractors_has_no_masks(tiny_run, tmp_path: Path):
    from nerfstudio.scripts import train

    from desplat_ns.commands.export import Masks

    config: Any = tiny_run(tmp_path / "runs")
    config.max_num_iterations = 2
    config.pipeline.model.effects.distractors = False
    train.main(config)
    with pytest.raises(ConfigError, match=r"no distractors.*effects\.distractors was False"):
        Masks(config.get_base_dir() / "config.yml", tmp_path / "masks").main()
    assert not (tmp_path / "masks").exists()


@pytest.mark.slow
def test_a_light_is_refused_where_photos_have_none(trained: Path, tmp_path: Path):
    from desplat_ns.commands.export import Splats

    with pytest.raises(ConfigError, match=r"--light is 'a\.jpg'.*same colours"):
        Splats(trained, tmp_path / "a.ply", light="a.jpg").main()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_page_is_whole_and_not_replaced_unasked(trained: Path, tmp_path: Path, capsys):
    from desplat_ns.commands.export import Page

    Page(trained, tmp_path / "a.html", training_photos=2).main()
    said = " ".join(capsys.readouterr().out.split())
    size = (tmp_path / "a.html").stat().st_size
    assert f"a page with the scene in it, {size / 1e6:.1f} MB" in said
    assert "2 of 6 training photos" in said
    assert [path.name for path in tmp_path.iterdir()] == ["a.html"]
    with pytest.raises(ConfigError, match="--overwrite"):
        Page(trained, tmp_path / "a.html").main()


SPLATS = ["splats", "--load-config", "absent.yml", "--output"]
PAGE = ["page", "--load-config", "absent.yml", "--output"]
MASKS = ["masks", "--load-config", "absent.yml", "--output", "masks"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["--help"], 0, "masks"),
        (["splats", "--help"], 0, "--crop"),
        ([*SPLATS, "a.ply"], 1, "Error: There is no 'absent.yml'"),
        ([*SPLATS, "a.obj"], 1, "the ending '.obj'. Known are: .ply (PLY), .spz (SPZ)"),
        ([*SPLATS, "a"], 1, "has no ending"),
        ([*SPLATS, "a.ply", "--crop", "0"], 1, "`--crop` is 0.0; it has to be above 0"),
        ([*SPLATS, "a.ply", "--crop", "nan"], 1, "`--crop` is nan"),
        ([*MASKS, "--dilate", "-1"], 1, "`--dilate` is -1.0; it has to be 0 or more"),
        (MASKS, 1, "Error: There is no 'absent.yml'"),
        (["page", "--help"], 0, "--megabytes"),
        ([*PAGE, "a.html"], 1, "Error: There is no 'absent.yml'"),
        ([*PAGE, "a.htm"], 1, "give it the ending .html"),
        ([*PAGE, "a.html", "--megabytes", "0"], 1, "`--megabytes` is 0.0"),
        ([*SPLATS, "a.html"], 1, "desplat-export page"),
    ],
)
def test_help_and_mistakes_import_nothing_heavy(
    arguments: list[str], status: int, words: str, checkout: Path
):
    check_quick_command("export", arguments, status, words, checkout)
