"""What the documents say can be done: commands are taken, and the shortest way is gone."""

import re
import shlex
import sys
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest
import tyro
from nerfstudio.scripts import train
from nerfstudio.utils import writer

from lab.synthetic import write_scene
from tests.helpers.registered import EIGHT_VIEWS

PROGRAM = re.compile(
    r"(?:ns|desplat)-[a-z-]+$|desplat$|make$|(?:.*/)?python[\d.]*$|(?:.*/)?pip$|uv$"
)


@dataclass(frozen=True)
class Documented:
    """A command in an indented or fenced block of a page."""

    page: str
    words: tuple[str, ...]
    """Without what is set before it (`VARIABLE=value`), and without its comment."""

    @property
    def program(self) -> str:
        return self.words[0].rsplit("/", 1)[-1]


def commands_of(page: Path) -> list[Documented]:
    found, is_fenced = [], False
    for line in page.read_text("utf8").replace("\\\n", "").splitlines():
        is_fenced ^= line.startswith("```")
        if not is_fenced and not line.startswith("    "):
            continue
        try:
            words = shlex.split(line, comments=True)
        except ValueError:  # an apostrophe: no command
            continue
        while words and re.match(r"[A-Z_]+=", words[0]):
            words = words[1:]
        for cut in (">", "|", "&&"):
            words = words[: words.index(cut)] if cut in words else words
        if words and PROGRAM.match(words[0]):
            found.append(Documented(page.name, tuple(words)))
    return found


@pytest.fixture(scope="module")
def documented(checkout: Path) -> list[Documented]:
    """Every command of README, CONTRIBUTING and docs/."""
    pages = [checkout / "README.md", checkout / "CONTRIBUTING.md", *checkout.glob("docs/**/*.md")]
    return [command for page in pages for command in commands_of(page)]


class Parsed(Exception):
    """What tyro made of a program's words, in place of what the program does with it."""


def parse(command: Documented) -> Any:
    """What tyro makes of the words of a program of ours or nerfstudio's, which leaves by SystemExit
    where it takes them not."""
    (script,) = entry_points(group="console_scripts", name=command.program)
    program, read = script.load(), tyro.cli

    def stop(*arguments: Any, **options: Any) -> Any:
        raise Parsed(read(*arguments, **options))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", list(command.words))
        patch.setattr(sys, "excepthook", sys.excepthook)
        patch.setattr(tyro, "cli", stop)
        try:
            program()
        except Parsed as parsed:
            (result,) = parsed.args
        except SystemExit:
            pytest.fail(f"{command} is not taken")
    if isinstance(result, tuple):  # what follows are a data parser's name and options
        result, rest = result
        assert not rest or not rest[0].startswith("-"), f"{command} is not taken: {rest}"
    return result


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_every_command_in_the_documents_is_taken_by_its_program(
    checkout: Path, documented: list[Documented]
):
    makefile = (checkout / "Makefile").read_text("utf8")
    by_words = {command.words: command for command in documented}
    assert len(by_words) > 40
    for command in by_words.values():
        program, words = command.program, command.words[1:]
        if program.startswith(("ns-", "desplat")):
            parse(command)
        elif program == "make":
            for target in (word for word in words if "=" not in word):
                assert re.search(rf"^{target}:", makefile, re.MULTILINE), command
        elif program.startswith("python") and words[0] == "-m" and words[1] not in ("pip", "venv"):
            import_module(words[1])


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_readme_s_way_from_a_capture_to_a_scene_in_a_page_can_be_gone(
    documented: list[Documented], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """As it stands there, but for the number of steps; what comes before, `desplat-process`, has
    tests of its own."""
    way = [command for command in documented if command.page == "README.md"]
    way = [command for command in way if command.program.startswith(("ns-", "desplat-"))]
    assert [command.program for command in way[:2]] == ["desplat-process", "ns-train"]
    write_scene(EIGHT_VIEWS, tmp_path / "capture")
    monkeypatch.chdir(tmp_path)
    for command in way[1:]:
        short = ("--max-num-iterations", "24") if command.program == "ns-train" else ()
        parsed = parse(replace(command, words=command.words + short))
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
    blocks = re.findall(r"^```python\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)
    assert len(blocks) > 5
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    for block in blocks:
        exec(block.replace("outputs/capture/desplat/run/config.yml", str(trained)), names)
    assert names["image"].shape == (120, 160, 3)
    assert set(names["full"]) and all(mask.dtype == bool for mask in names["full"].values())
