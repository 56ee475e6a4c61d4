"""What the documents say can be done: commands are taken, and the shortest way is gone."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from lab.synthetic import write_scene
from tests.helpers.documented import Documented, commands, pages, parse, python_blocks
from tests.helpers.registered import EIGHT_VIEWS


def documented(checkout: Path) -> list[Documented]:
    """Every command on every page."""
    return [call for page in pages(checkout) for call in commands(page, page.read_text("utf8"))]


def test_commands_are_found_with_their_continuations_and_without_comments():
    text = "# T\n\n    ns-eval --load-config a \\\n        --output-path b   # c\n\nns-train x\n"
    (command,) = commands(Path("p.md"), text)
    assert (command.line, command.program) == (3, "ns-eval")
    assert command.words == ("ns-eval", "--load-config", "a", "--output-path", "b")


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_every_command_in_the_documents_is_taken_by_its_program(checkout: Path):
    by_words = {command.words: command for command in documented(checkout)}
    assert len(by_words) > 40
    for command in by_words.values():
        parse(command, checkout)


def test_a_command_with_an_option_that_is_not_there_is_noticed(checkout: Path):
    for words in (("desplat-report", "--load-config", "a", "--no-such", "1"), ("make", "no-such")):
        with pytest.raises(AssertionError, match="no-such"):
            parse(Documented("p.md", 1, words), checkout)


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_readme_s_way_from_a_capture_to_a_scene_in_a_page_can_be_gone(
    checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """As it stands there, but for the number of steps; what comes before, `desplat-process`, has
    tests of its own."""
    from nerfstudio.scripts import train
    from nerfstudio.utils import writer

    way = [command for command in documented(checkout) if command.page == "README.md"]
    way = [command for command in way if command.program.startswith(("ns-", "desplat-"))]
    assert [command.program for command in way[:2]] == ["desplat-process", "ns-train"]
    write_scene(EIGHT_VIEWS, tmp_path / "capture")
    monkeypatch.chdir(tmp_path)
    for command in way[1:]:
        short = ("--max-num-iterations", "24") if command.program == "ns-train" else ()
        parsed: Any = parse(Documented(command.page, command.line, command.words + short), checkout)
        train.main(parsed) if command.program == "ns-train" else parsed.main()
    for events in writer.EVENT_WRITERS:  # before the folder is no longer where they are
        events.tb_writer.close() if isinstance(events, writer.TensorboardWriter) else None
    run = tmp_path / "outputs" / "capture" / "desplat" / "run"
    for made in (run / "report.html", tmp_path / "scene.ply", tmp_path / "scene.html"):
        assert made.stat().st_size > 1000, made


def test_the_python_on_its_page_runs(
    checkout: Path, trained: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    text = (checkout / "docs" / "reference" / "files.md").read_text("utf8")
    blocks = python_blocks(text)
    assert len(blocks) > 5
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in blocks:
        exec(block.replace("outputs/capture/desplat/run/config.yml", str(trained)), names)
    assert names["image"].shape == (120, 160, 3)
    assert set(names["full"]) and all(mask.dtype == bool for mask in names["full"].values())


def test_no_program_of_the_package_is_without_a_page(checkout: Path):
    known = {command.program for command in documented(checkout)}
    text = (checkout / "pyproject.toml").read_text("utf8")
    assert (
        set(re.findall(r"^(desplat-\w[\w-]*) = \"desplat_ns.commands", text, re.MULTILINE)) <= known
    )
