"""`desplat-report`: a trained run on one HTML page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from desplat_ns.commands import run
from desplat_ns.console import announce
from desplat_ns.errors import ConfigError
from desplat_ns.files.whole import check_new_file
from desplat_ns.runs.files import find_run
from desplat_ns.settings.options import check_ranges, ranged


@dataclass
class Report:
    """Write a trained run on one HTML page that needs no other file.

    The scene itself, to walk around in; each training photo beside the static scene, its
    distractors and their mask; held-out photos with error maps and scores; curves, effects and why
    they were chosen, cost, warnings.
    """

    load_config: Path
    """config.yml of the run."""
    output: Path | None = None
    """The page, FILE.html. Without it: report.html beside config.yml."""
    training_photos: int = ranged(50, "[0, inf)")
    """Training photos to show; of more, as many evenly spread over the capture."""
    held_out_photos: int = ranged(12, "[0, inf)")
    """Held-out photos to show, the worst first. All are scored; 0: none is, and no time spent."""
    scene: bool = True
    """The scene itself on top, to walk around in; the page is 25 MB at most then, else 10."""

    def main(self) -> None:
        """Check what can be checked at once, then load, render, write, say where.

        Raises:
            DeSplatError: the run is not there or cannot be loaded, or the page not be written.
        """
        check_ranges(self)
        files = find_run(self.load_config)
        output = self.output or files.folder / "report.html"
        if output.suffix != ".html":
            raise ConfigError(f"--output is '{output}'; give it the ending .html.")
        check_new_file(output, overwrite=True)

        from desplat_ns.report.report import write_report  # seconds: not before the checks
        from desplat_ns.studies.machine import describe_machine

        photos = self.training_photos, self.held_out_photos
        size = write_report(files, output, *photos, describe_machine(), self.scene)
        announce(f"Saved the page to: {output} ({size / 1e6:.1f} MB)")


def main() -> None:
    """Entry point of the command."""
    run(Report, description=__doc__)
