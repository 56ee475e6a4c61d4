"""What the demo shows while commands work: a progress bar, and the end of the log if one fails."""

import contextlib
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from desplat_ns.core.errors import DeSplatError

CONSOLE = Console(highlight=False)

STEP = re.compile(r"^Step ([\d,]+) of ")
"""How a line about a training step begins."""


class DemoError(DeSplatError):
    """The demo cannot go on."""


def shown(path: str | Path) -> str:
    """The path as somebody in this folder would type it; other words stay as they are."""
    if not Path(path).is_absolute():
        return str(path)
    relative = os.path.relpath(path)
    return str(path) if relative.startswith("..") else relative


@contextlib.contextmanager
def progress_bar(label: str) -> Iterator[Callable[[int, int], None]]:
    """Yields what takes (step, steps): it moves a bar, or where nobody watches prints tenths."""
    tenths = 0

    def say(step: int, steps: int) -> None:
        nonlocal tenths
        if step * 10 // steps > tenths:
            tenths = step * 10 // steps
            CONSOLE.print(f"{label} {step}/{steps}")

    if not CONSOLE.is_terminal:
        yield say
        return
    columns = TextColumn(label), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=CONSOLE, transient=True) as progress:
        task = progress.add_task(label, total=None)  # it pulses until the first step is done
        yield lambda step, steps: progress.update(task, completed=step, total=steps)


def find_program(name: str) -> str:
    """A command of the environment that runs the demo. Raises DemoError where it is not there."""
    beside = Path(sys.executable).with_name(name)
    found = str(beside) if beside.exists() else shutil.which(name)
    if found is None:
        raise DemoError(
            f"`{name}` is not installed. Type `make demo`, which installs all it needs."
        )
    return found


def execute(line: Sequence[object], log: Path, label: str, steps: int = 1) -> None:
    """Run one of nerfstudio's commands with a progress bar; what it prints goes to `log`.

    Raises DemoError with the last lines it printed where it fails.
    """
    program, *arguments = map(str, line)
    typed = shlex.join([program, *map(shown, arguments)])
    CONSOLE.print(f"[dim]$ {typed}[/dim]", soft_wrap=True)
    quiet = {"PYTHONUNBUFFERED": "1", "PYTHONWARNINGS": "ignore", "COLUMNS": "120"}
    last: deque[str] = deque(maxlen=25)
    with (
        log.open("w") as file,
        progress_bar(label) as advance_to,
        subprocess.Popen(
            [find_program(program), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={"OMP_WAIT_POLICY": "passive"} | os.environ | quiet,
        ) as process,
    ):
        for text in process.stdout or ():
            file.write(text)
            last.append(text.rstrip())
            if found := STEP.match(text):
                advance_to(int(found[1].replace(",", "")), steps)
    if process.returncode != 0:
        raise DemoError("\n".join([*last, f"{typed}\nfailed. Its whole log: {shown(log)}"]))


@contextlib.contextmanager
def printing_to(log: Path) -> Iterator[None]:
    """Within, everything that Python prints goes to a file."""
    with log.open("w") as file, contextlib.redirect_stdout(file), contextlib.redirect_stderr(file):
        yield
