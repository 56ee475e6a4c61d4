"""What a user can get wrong. Each error says what was found, what was needed and what to type."""

import sys
import warnings
from types import TracebackType


class DeSplatError(Exception):
    """A mistake that the user can mend; the commands print its message without a traceback."""


class BackendUnavailableError(DeSplatError):
    """The chosen rasterizer cannot run here."""


class CaptureError(DeSplatError):
    """The capture on disk (photos, reconstruction, split) cannot be used as it is."""


class CheckpointError(DeSplatError):
    """A checkpoint is damaged, or belongs to another scene or to other effects."""


class ConfigError(DeSplatError):
    """Options that contradict each other or lie outside their range."""


class TrainingError(DeSplatError):
    """Training cannot go on: what it computes, or its state, is not finite any more."""


def printable(text: str) -> str:
    """A text in one line, whatever files are called: line breaks, escapes that a terminal would
    follow, and bytes that are no text, become `\\n`, `\\x1b` and `\\udcfc`."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def begin_run() -> None:
    """A run or a command of this package begins: from now on, a `DeSplatError` or Ctrl+C that ends
    the program, which may be nerfstudio's, prints no traceback, and nothing is said of what torch
    and nerfstudio have to change, and users cannot (`-W` still shows it)."""
    warnings.filterwarnings("ignore", "", FutureWarning, r"(torch|nerfstudio)\.", append=True)
    before = sys.excepthook
    if before.__module__ == __name__:
        return

    def hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        if isinstance(error, DeSplatError):
            print(f"\nError: {printable(str(error))}", file=sys.stderr)
        elif isinstance(error, KeyboardInterrupt):
            print("\nEnded by Ctrl+C.", file=sys.stderr)
        else:
            before(kind, error, trace)

    sys.excepthook = hook
