"""What is tracked works anywhere: no paths of one machine, no download addresses."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

FOREIGN_PATH = re.compile(r"(?<![\w.])/(?:home|root|Users)/\w")
DOWNLOAD_ADDRESS = re.compile(
    r"--(?:extra-)?index[-]url|--find[-]links|//files\.pythonhosted|//pypi\.org/simple"
)
LOCK_FILES = {"uv.lock", "poetry.lock", "Pipfile.lock", "pdm.lock"}
LARGEST = 1_000_000
"""Bytes; what is larger is data, and data is generated."""


@pytest.fixture(scope="module")
def tracked(checkout: Path) -> list[Path]:
    """Files that git tracks."""
    if shutil.which("git") is None or not (checkout / ".git").exists():
        pytest.skip("not a git checkout")
    listing = subprocess.run(
        ["git", "ls-files", "-z"], cwd=checkout, capture_output=True, text=True, check=True
    )
    paths = [checkout / name for name in listing.stdout.split("\0") if name]
    return [path for path in paths if path.is_file()]


@pytest.fixture(scope="module")
def texts(tracked: list[Path]) -> dict[Path, str]:
    """Contents of the tracked text files."""
    raw = {path: path.read_bytes() for path in tracked}
    return {path: data.decode() for path, data in raw.items() if b"\0" not in data}


def lines_with(pattern: re.Pattern[str], texts: dict[Path, str]) -> list[str]:
    """`file:line: text` wherever `pattern` is found."""
    return [
        f"{path.name}:{number}: {line.strip()}"
        for path, text in texts.items()
        for number, line in enumerate(text.splitlines(), 1)
        if pattern.search(line)
    ]


def test_no_file_names_a_folder_of_somebodys_machine(
    checkout: Path, texts: dict[Path, str]
) -> None:
    here = re.compile("|".join(re.escape(f"{p}/") for p in {checkout.parent, Path.home()}))
    assert lines_with(FOREIGN_PATH, texts) + lines_with(here, texts) == []


def test_no_file_records_where_packages_were_downloaded(texts: dict[Path, str]) -> None:
    assert lines_with(DOWNLOAD_ADDRESS, texts) == []


def test_the_patterns_find_what_they_are_for() -> None:
    assert FOREIGN_PATH.search('cd "/' + 'home/ada/scene"')
    assert DOWNLOAD_ADDRESS.search("pip install --extra-index" + "-url https://example.org")
    assert not FOREIGN_PATH.search("outputs/home/run")


def test_no_lock_file_is_tracked(tracked: list[Path]) -> None:
    assert [path.name for path in tracked if path.name in LOCK_FILES] == []


def test_no_large_file_is_tracked(tracked: list[Path]) -> None:
    assert [path.name for path in tracked if path.stat().st_size > LARGEST] == []


def test_the_root_method_configs_is_a_link_into_the_package(checkout: Path) -> None:
    link = checkout / "method_configs.py"
    assert link.is_symlink()
    assert link.readlink() == Path("desplat_ns/method_configs.py")


def test_shapes_are_checked_while_the_tests_run() -> None:
    """Fails where pytest runs without jaxtyping's two-entry option: shapes would go unchecked."""
    import torch

    from desplat_ns.rendering.compositing import composite_alpha

    with pytest.raises(Exception, match=r"[Tt]ype-check"):
        composite_alpha(torch.zeros(2, 3, 1), torch.zeros(3, 2, 1))
