"""`desplat-process`: photos or a video to a capture with poses, which ns-train reads."""

from __future__ import annotations

import tyro

from desplat_ns.errors import print_user_errors_plainly
from desplat_ns.process.request import Request, find_sources


def run(request: Request) -> None:
    """Check what can be checked at once, then make the capture; raises as `process.process`."""
    request.check()
    sources = find_sources(request.photos, request.output)

    from desplat_ns.process.process import process  # takes a second: not before the checks

    process(request, sources)


def main() -> None:
    """Entry point of the command."""
    print_user_errors_plainly()
    run(tyro.cli(Request, prog="desplat-process", description=__doc__))
