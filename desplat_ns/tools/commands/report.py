"""`desplat-report`: a trained run on one HTML page."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

from desplat_ns.core.options import ranged
from desplat_ns.core.whole import check_new_file
from desplat_ns.tools.commands import OfRun, run


@dataclass(kw_only=True)
class Report(OfRun):
    """Write a trained run on one HTML page that needs no other file.

    The scene itself, to walk around in; each training photo beside the static scene, its
    distractors and their mask; held-out photos with error maps and scores; effects and why they
    were chosen, warnings.
    """

    output: Path | None = None
    """The page, FILE.html. Without it: report.html beside config.yml."""
    training_photos: int = ranged(50, "[0, inf)")
    """Training photos to show; of more, as many evenly spread over the capture."""
    held_out_photos: int = ranged(12, "[0, inf)")
    """Held-out photos to show, the worst first. All are scored; 0: none is, and no time spent."""
    scene: bool = True
    """The scene itself on top, to walk around in. The page is 10 MB at most, with or without."""

    def main(self) -> None:
        """Check what can be checked at once, then load, render, write. Raises DeSplatError."""
        files = self.find()
        output = self.output or files.folder / "report.html"
        check_new_file(output, overwrite=True, ending=".html")

        from desplat_ns.tools.report.page import write_report  # seconds: not before the checks

        write_report(files, output, self)


main = partial(run, Report, description=__doc__)
