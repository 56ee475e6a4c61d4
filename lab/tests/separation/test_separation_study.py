"""The study of docs/results/separation.md: its plan, its memory, its tables, its one-pixel
model."""

from typing import Any

import numpy as np
import pytest

from desplat_ns.data.images import read_image, read_mask
from desplat_ns.studies.methods import method_config
from lab.grid.figures import NOT_YET, Figures
from lab.grid.records import Record, Records
from lab.grid.runs import Run
from lab.separation import one_pixel, report
from lab.separation.hard_cases import CASES, RECURRING, make_case
from lab.separation.runs import PLAN, SCENES, SEEDS, SETTINGS
from lab.synthetic import Scene


def test_every_run_of_the_plan_is_there_once_and_known():
    names = [run.name for run in PLAN]
    assert len(names) == len(set(names))
    assert {run.setting for run in PLAN} == set(SETTINGS)
    assert {run.scene for run in PLAN} <= set(SCENES)


@pytest.mark.parametrize("setting", SETTINGS.values(), ids=list(SETTINGS))
def test_options_of_a_setting_exist(setting):
    config: Any = method_config(setting.method)
    for option in setting.options[::2]:
        node = config
        for name in option.removeprefix("--").split("."):
            assert hasattr(node, name.replace("-", "_")), option
            node = getattr(node, name.replace("-", "_"))


MAIN = ("off", "desplat", "paper")
RESULTS = {"psnr": 26.0, "ssim": 0.9, "num_static_gaussians": 5, "num_distractor_gaussians": 7}


def fake(values: dict[tuple[str, str], list[float]]) -> Records:
    return {
        Run(setting, scene, 2, 1000, seed).name: Record(RESULTS | {"psnr": psnr}, "0" * 40)
        for (setting, scene), psnrs in values.items()
        for seed, psnr in zip((42, 43, 44), psnrs, strict=False)
    }


def figures_of(records: Records) -> Figures:
    return Figures(records, SEEDS)


def test_a_gap_is_closed_seed_by_seed_and_summed_up_by_its_median():
    figures = figures_of(
        fake(
            {
                ("off", "clutter"): [20.0, 21.0, 20.0],
                ("off", "clean"): [30.0, 31.0, 30.0],
                ("desplat", "clutter"): [25.0, 29.0, 26.0],
            }
        )
    )
    gap = report.gap(figures, "desplat", "clutter", "clean", 2, 1000)
    assert gap.text == "0.60 (0.50 - 0.80)" and len(gap.records) == 9
    text = report.scene_table(figures, MAIN, "clutter", "clean", 2, 1000)
    assert "| **`desplat`** | 26.00 (25.00 - 29.00) | 0.60 (0.50 - 0.80) |" in text
    assert "paper" not in text
    assert text.endswith("Records: 9 of 0000000.")


def test_a_seed_that_is_missing_in_one_run_is_left_out_of_the_gap():
    entries = fake(
        {
            ("off", "clutter"): [20.0, 21.0, 22.0],
            ("off", "clean"): [30.0, 31.0, 32.0],
            ("desplat", "clutter"): [25.0, 29.0, 25.0],
        }
    )
    del entries[Run("off", "clutter", 2, 1000, 43).name]
    gap = report.gap(figures_of(entries), "desplat", "clutter", "clean", 2, 1000)
    assert gap.text == "0.40 (0.30 - 0.50)"


def test_a_capture_has_a_row_once_it_was_measured():
    now = figures_of(fake({("desplat", "clutter"): [26.0], ("off", "clean"): [30.0]}))
    head, _, *rows = report.captures_table(now, "chosen", 1000).splitlines()
    assert head.startswith("| capture | `desplat` | clean twins | SSIM |")  # no empty columns
    assert rows[0].startswith("| clutter | 26.00 | 30.00 |")
    assert rows[0].endswith(f"| {7 * 14 / (5 * 59):.2f} |")
    assert rows[1] == ""


def test_a_report_can_be_written_at_any_time(tmp_path, monkeypatch):
    monkeypatch.setattr(one_pixel, "draw", lambda path: path.touch())
    text = report.write_report(figures_of({}), tmp_path).read_text()
    assert NOT_YET in text
    assert "{{" not in text and "$" not in text


def test_one_pixel_shows_haze_with_one_loss_and_none_with_placed_distractors():
    paper, *_, placed = (one_pixel.simulate(rules, 1500) for rules in one_pixel.RULES)
    assert paper.haze[-1] > 0.04
    assert placed.haze[-1] == 0
    assert placed.cover[-1] > 0.5 > paper.cover[-1]
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
