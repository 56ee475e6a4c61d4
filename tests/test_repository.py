"""What is tracked works anywhere: no paths of one machine, no download addresses, no data."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import torch

from desplat_ns.layers import composite_alpha

FOREIGN = re.compile(
    r"(?<![\w.])/(?:home|root|Users)/\w"
    r"|--(?:extra-)?index[-]url|--find[-]links|//files\.pythonhosted|//pypi\.org/simple"
)
LOCK_FILES = {"uv.lock", "poetry.lock", "Pipfile.lock", "pdm.lock"}
LARGEST = 5_000_000
"""Bytes; what is larger is data, and data is generated."""


def test_no_tracked_file_is_of_one_machine_or_large(checkout: Path):
    if shutil.which("git") is None or not (checkout / ".git").exists():
        pytest.skip("not a git checkout")
    listing = subprocess.run(
        ["git", "ls-files", "-z"], cwd=checkout, capture_output=True, text=True, check=True
    )
    assert FOREIGN.search('cd "/' + 'home/ada/scene"')
    for path in (checkout / name for name in listing.stdout.split("\0") if name):
        if path.is_file():
            content = path.read_bytes()
            assert len(content) <= LARGEST and path.name not in LOCK_FILES, path
            text = "" if b"\0" in content else content.decode()
            assert not FOREIGN.search(text) and f"{checkout}/" not in text, path


def test_the_root_method_configs_is_a_link_into_the_package(checkout: Path):
    link = checkout / "method_configs.py"
    assert link.is_symlink()
    assert link.readlink() == Path("desplat_ns/method_configs.py")


def test_shapes_are_checked_while_the_tests_run():
    """Fails where pytest runs without jaxtyping's two-entry option: shapes would go unchecked."""
    with pytest.raises(Exception, match=r"[Tt]ype-check"):
        composite_alpha(torch.zeros(2, 3, 1), torch.zeros(3, 2, 1))
