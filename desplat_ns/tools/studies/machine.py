"""What figures were measured on and with which code. Nothing that names the machine itself."""

import datetime
import platform
import re
import subprocess
from pathlib import Path

import desplat_ns

DIRTY = "-dirty"
"""Ends the commit where files of the package differ from it."""


def code_version(package: Path = Path(desplat_ns.__file__).parent) -> str:
    """The commit of a package's folder, with `DIRTY` behind it where a file there was changed or
    added; `desplat-ns` and the version where git does not track the package."""

    def git(*arguments: str) -> str:
        line = ["git", "-C", str(package), *arguments]
        return subprocess.run(line, capture_output=True, text=True, check=True).stdout

    try:
        git("ls-files", "--error-unmatch", "__init__.py")
        changed = git("status", "--porcelain", "--", ".")
        return git("rev-parse", "HEAD").strip() + DIRTY * bool(changed)
    except (OSError, subprocess.CalledProcessError):
        return f"desplat-ns {desplat_ns.__version__}"


def short(commit: str) -> str:
    """A commit as tables give it, by seven digits; what is no commit stays as it is."""
    digits = commit.removesuffix(DIRTY)
    is_hash = len(digits) == 40 and set(digits) <= set("0123456789abcdef")
    return (digits[:7] if is_hash else digits) + ", with changes" * commit.endswith(DIRTY)


def today() -> str:
    """The day, ISO 8601, UTC."""
    return datetime.datetime.now(datetime.timezone.utc).date().isoformat()


def device_name(device: str) -> str:
    """The name of the GPU `cuda:N`, or of the processor for any other torch device."""
    if not device.startswith("cuda"):
        return processor()
    import torch

    return torch.cuda.get_device_name(device)


def processor() -> str:
    """The model of the processor, or its architecture where the system does not tell."""
    file = Path("/proc/cpuinfo")
    named = re.search(r"^model name\s*: (.+)$", file.read_text(), re.M) if file.is_file() else None
    return named[1] if named else platform.processor() or platform.machine()
