"""What the documents say can be done: commands are taken, and the Python runs."""

import re
import shlex
import sys
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest
import tyro

PROGRAM = re.compile(
    r"(?:ns|desplat)-[a-z-]+$|desplat$|make$|(?:.*/)?python[\d.]*$|(?:.*/)?pip$|uv$"
)


def commands_of(page: Path) -> list[tuple[str, ...]]:
    """The words of each command in an indented or fenced block of a page, without what is set
    before it (`VARIABLE=value`) and without its comment."""
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
            found.append(tuple(words))
    return found


class Parsed(Exception):
    """What tyro made of a program's words, in place of what the program does with it."""


def assert_taken(program: str, words: tuple[str, ...], page: str) -> None:
    """By a program of ours or nerfstudio's, which leaves by SystemExit where it takes them not."""
    (script,) = entry_points(group="console_scripts", name=program)
    main, read = script.load(), tyro.cli

    def stop(*arguments: Any, **options: Any) -> Any:
        raise Parsed(read(*arguments, **options))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", list(words))
        patch.setattr(sys, "excepthook", sys.excepthook)
        patch.setattr(tyro, "cli", stop)
        try:
            main()
        except Parsed as parsed:
            (result,) = parsed.args
        except SystemExit:
            pytest.fail(f"{words} of {page} are not taken")
    if isinstance(result, tuple):  # what follows are a data parser's name and options
        rest = result[1]
        assert not rest or not rest[0].startswith("-"), f"{rest} of {page} are not taken"


@pytest.mark.slow
@pytest.mark.usefixtures("tyro_may_build")
def test_every_command_in_the_documents_is_taken_by_its_program(checkout: Path):
    makefile = (checkout / "Makefile").read_text("utf8")
    pages = [checkout / "README.md", checkout / "CONTRIBUTING.md", *checkout.glob("docs/**/*.md")]
    page_of = {words: page.name for page in pages for words in commands_of(page)}
    assert len(page_of) > 40
    for words, page in page_of.items():
        program, rest = words[0].rsplit("/", 1)[-1], words[1:]
        if program.startswith(("ns-", "desplat")):
            assert_taken(program, words, page)
        elif program == "make":
            for target in (word for word in rest if "=" not in word):
                assert re.search(rf"^{target}:", makefile, re.MULTILINE), (target, page)
        elif program.startswith("python") and rest[0] == "-m" and rest[1] not in ("pip", "venv"):
            import_module(rest[1])


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
