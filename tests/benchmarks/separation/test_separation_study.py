"""The study of docs/separation.md: its plan, its memory, its tables, its one-pixel model."""

import argparse
import json
from typing import Any

import numpy as np
import pytest
import torch

from benchmarks.separation import one_pixel, records, report
from benchmarks.separation.hard_cases import CASES, RECURRING, make_case
from benchmarks.separation.runs import PLAN, SCENES, SETTINGS, Run
from desplat_ns.data.images import read_image, read_mask
from desplat_ns.method_configs import desplat, desplat_paper
from desplat_ns.studies.grid.commands import QUIET, run_command
from desplat_ns.studies.reproduce.baselines import TRIMMED_SHARE, _trimmed, by_residual, by_truth
from desplat_ns.synthetic import Scene

METHODS = {m.config.method_name: m.config for m in (desplat, desplat_paper, by_truth, by_residual)}


def test_every_run_of_the_plan_is_there_once_and_known():
    names = [run.name for run in PLAN]
    assert len(names) == len(set(names))
    assert {run.setting for run in PLAN} == set(SETTINGS)
    assert {run.scene for run in PLAN} == set(SCENES)


@pytest.mark.parametrize("setting", SETTINGS.values(), ids=list(SETTINGS))
def test_options_of_a_setting_exist(setting):
    config: Any = METHODS[setting.method]
    for option in setting.options[::2]:
        node = config
        for name in option.removeprefix("--").split("."):
            assert hasattr(node, name.replace("-", "_")), option
            node = getattr(node, name.replace("-", "_"))


RESULTS = {"psnr": 26.0, "ssim": 0.9, "num_static_gaussians": 5, "num_distractor_gaussians": 7}


def test_a_run_is_done_once_it_is_recorded_with_the_options_of_today(tmp_path, monkeypatch):
    run, path = PLAN[0], tmp_path / "records.json"
    assert not records.is_done(run, records.load(path))
    records.add(run, RESULTS | {"something": "else", "train_cpu_seconds": 12.34}, path)
    found = records.load(path)
    assert records.is_done(run, found)
    assert found[run.name]["train_cpu_seconds"] == 12.3
    assert "something" not in found[run.name]
    changed = argparse.Namespace(options=("--other", "1"))
    monkeypatch.setitem(SETTINGS, run.setting, changed)
    assert not records.is_done(run, found)


@pytest.mark.slow
def test_a_run_is_trained_and_scored_as_by_nerfstudios_commands(tiny_scene, tmp_path):
    target = tmp_path / "results.json"
    line = ["python", "-m", "desplat_ns.studies.grid.train_and_score", target, "desplat"]
    line += ["--data", tiny_scene.folder, "--max-num-iterations", "3", "--output-dir", tmp_path]
    line += [*QUIET, "--pipeline.model.num-downscales", "0", "robustnerf-data"]
    run_command(line, tmp_path / "log")
    results = json.loads(target.read_text())
    assert results["num_images"] == 2 and results["num_masks"] == 6
    assert set(records.FIGURES) <= set(results)
    assert results["train_cpu_seconds"] > 0
    assert (tmp_path / "x" / "desplat" / "run" / "nerfstudio_models").is_dir()


def fake(values: dict[tuple[str, str], list[float]]) -> dict[str, dict[str, Any]]:
    return {
        Run(setting, scene, 2, 1000, seed).name: RESULTS | {"psnr": psnr}
        for (setting, scene), psnrs in values.items()
        for seed, psnr in zip((42, 43, 44), psnrs, strict=False)
    }


def test_a_gap_is_closed_seed_by_seed_and_summed_up_by_its_median():
    figures = report.Figures(
        fake(
            {
                ("off", "clutter"): [20.0, 21.0, 20.0],
                ("off", "clean"): [30.0, 31.0, 30.0],
                ("desplat", "clutter"): [25.0, 29.0, 26.0],
            }
        )
    )
    assert figures.gaps("desplat", "clutter", "clean", 2, 1000) == pytest.approx([0.5, 0.8, 0.6])
    text = report.scene_table(figures, "off desplat paper", "clutter", "clean", 2, 1000)
    assert "| **`desplat`** | 26.00 (25.00 - 29.00) | 0.60 (0.50 - 0.80) |" in text
    assert "paper" not in text


def test_a_seed_that_is_missing_in_one_run_is_left_out_of_the_gap():
    found = fake(
        {
            ("off", "clutter"): [20.0, 21.0, 22.0],
            ("off", "clean"): [30.0, 31.0, 32.0],
            ("desplat", "clutter"): [25.0, 29.0, 25.0],
        }
    )
    del found[Run("off", "clutter", 2, 1000, 43).name]
    gaps = report.Figures(found).gaps("desplat", "clutter", "clean", 2, 1000)
    assert gaps == pytest.approx([0.5, 0.3])


def test_captures_stand_with_what_they_were_above_what_they_are():
    before = report.Figures(fake({("off", "clutter"): [20.0], ("desplat", "clutter"): [25.0]}))
    now = report.Figures(fake({("desplat", "clutter"): [26.0], ("off", "clean"): [30.0]}))
    first, second = report.changes_table(before, now, 1000).splitlines()[2:]
    assert first.startswith("| clutter | before | 20.00 | 25.00 |  |")
    assert second.startswith("| clutter | now |  | 26.00 | 30.00 |")
    assert second.endswith(f"| {7 * 14 / (5 * 59):.2f} |")


def test_a_report_can_be_written_at_any_time(tmp_path, monkeypatch):
    monkeypatch.setattr(one_pixel, "draw", lambda path: path.touch())
    text = report.write_report({}, {}, tmp_path).read_text()
    assert report.NOT_YET in text
    assert "{{" not in text and "$" not in text


def test_the_committed_document_is_that_of_the_committed_records(tmp_path, monkeypatch):
    monkeypatch.setattr(one_pixel, "draw", lambda path: path.touch())
    found, before = (json.loads(path.read_text()) for path in (records.FILE, records.BEFORE))
    again = report.write_report(found, before, tmp_path).read_text()
    assert again == (report.FOLDER / report.REPORT).read_text()


def test_one_pixel_shows_haze_with_one_loss_and_none_with_placed_distractors():
    paper, *_, placed = (one_pixel.simulate(rules, 1500) for rules in one_pixel.RULES)
    assert paper.haze[-1] > 0.04
    assert placed.haze[-1] == 0
    assert placed.found[-1] > 0.5 > paper.found[-1]
    assert placed.error[-1] < 0.02


@pytest.fixture(scope="module")
def cases(tiny_scene: Scene, tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("cases")
    assert tiny_scene.folder is not None
    for name in (*CASES, RECURRING):
        make_case(name, tiny_scene.folder, folder / name)
    return folder


@pytest.mark.parametrize(
    ("name", "share"),
    [
        ("white", (0.05, 0.13)),
        ("black", (0.05, 0.13)),
        ("large", (0.3, 0.5)),
        ("small", (0.05, 0.16)),
    ],
)
def test_a_case_covers_what_it_says_and_differs_nowhere_else(cases, tiny_scene, name, share):
    masks = []
    for path in sorted((cases / name / "images").glob("clutter_*")):
        mask = read_mask(cases / name / "masks" / f"{path.stem}.png")
        clean = path.name.replace("clutter", "clean")
        photo, original = read_image(path), read_image(tiny_scene.folder / "images" / clean)
        assert np.array_equal(photo[~mask], original[~mask])
        masks.append(mask.mean())
        if name in ("white", "black"):
            assert (photo[mask] > 200).all() if name == "white" else (photo[mask] < 50).all()
    assert share[0] < np.mean(masks) < share[1]


def test_the_recurring_one_stands_in_a_fifth_of_the_views(cases):
    masks = sorted((cases / RECURRING / "masks").iterdir())
    covered = [read_mask(path).mean() for path in masks]
    assert [share > 0.02 for share in covered] == [True, True, False, False, False, False]


def test_a_trimmed_loss_leaves_out_the_largest_residuals():
    rendered, photo = torch.zeros(20, 20, 3), torch.rand(20, 20, 3) * 0.1
    photo[5:12, 5:12] = 1.0
    left_out = _trimmed(rendered, photo)[..., 0]
    assert left_out[6:11, 6:11].all()
    assert left_out.float().mean() < 1 - TRIMMED_SHARE
