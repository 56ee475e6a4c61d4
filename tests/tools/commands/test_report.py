"""desplat-report on a tiny run: the page is whole; mistakes are told at once."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest
import yaml

from desplat_ns.core.errors import CaptureError
from desplat_ns.tools.commands.evaluate import Evaluate
from desplat_ns.tools.commands.report import Report

NUM_TRAIN, NUM_TEST = 6, 2


@pytest.fixture(scope="module")
def page(trained: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The page of a tiny run."""
    output = tmp_path_factory.mktemp("report") / "new" / "page.html"
    Report(trained, output=output).main()
    assert [path.name for path in output.parent.iterdir()] == ["page.html"]
    return output.read_text("utf8")


def test_the_page_of_a_run_has_every_photo_with_its_layers(page: str):
    alts = re.findall(r'<img[^>]* alt="([^"]*)"', page)
    for what in ("the photo", "its distractors", "the mask of its distractors"):
        assert sum(alt.endswith(f", {what}") for alt in alts) >= NUM_TRAIN, what
    assert sum(alt.endswith(", error map") for alt in alts) == NUM_TEST
    assert page.count('<input type="range"') == NUM_TRAIN
    assert len(re.findall(r"PSNR [.0-9]+ dB, SSIM [.0-9]+", page)) == NUM_TEST


def test_the_scene_itself_is_on_top_unless_it_is_not_wanted(
    page: str, trained: Path, tmp_path: Path
):
    (scene,) = re.findall(r'<iframe class="scene"[^>]* srcdoc="([^"]*)"', page)
    assert "class ScenePage" in scene and scene.count("extra_") >= NUM_TEST
    assert len(page.encode()) < 25_000_000
    Report(
        trained, output=tmp_path / "p.html", training_photos=1, held_out_photos=0, scene=False
    ).main()
    without = (tmp_path / "p.html").read_text("utf8")
    assert "<iframe" not in without and "wasm-unsafe-eval" not in without


def test_the_page_has_the_scores_of_ns_eval(page: str, trained: Path, tmp_path: Path):
    Evaluate(trained, output_path=tmp_path / "m.json").main()
    results: dict[str, Any] = json.loads((tmp_path / "m.json").read_text())["results"]
    assert f"{results['psnr']:.2f} dB" in page
    for image in results["images"]:
        assert f"PSNR {image['psnr']:.2f} dB, SSIM {image['ssim']:.3f}" in page
    assert f"<dd>{results['num_static_gaussians']:,}</dd>" in page
    assert "no record of a survey" in page


def test_a_run_and_its_capture_that_were_moved_have_a_page(
    trained: Path, tiny_scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """With the survey's findings beside the run."""
    config: Any = yaml.load(trained.read_text(), Loader=yaml.UnsafeLoader)
    config.output_dir = tmp_path / "gone"
    config.data = config.pipeline.datamanager.data = tmp_path / "gone"
    config.pipeline.datamanager.dataparser.data = tmp_path / "gone"
    (tmp_path / "my run").mkdir()
    (tmp_path / "my run" / "config.yml").write_text(yaml.dump(config))
    shutil.copytree(trained.parent / "nerfstudio_models", tmp_path / "my run/nerfstudio_models")
    finding = {"decision": "sh", "confidence": "clear", "reason": "There is a sky."}
    names = ("appearance", "background")
    (tmp_path / "my run" / "survey.json").write_text(json.dumps(dict.fromkeys(names, finding)))
    monkeypatch.chdir(tmp_path)
    run = Path("my run/config.yml")
    for data in (None, tmp_path / "elsewhere"):
        with pytest.raises(CaptureError, match="--data"):
            Report(run, data).main()
    Report(run, tiny_scene.folder, training_photos=1, held_out_photos=0).main()
    html = (tmp_path / "my run" / "report.html").read_text("utf8")
    assert "would have said sh: There is a sky." in html
    assert "--load-config &#39;my run/config.yml&#39;" in html, "as a shell takes it"
