"""`desplat-process`: photos or a video to a capture with poses, which ns-train reads."""

from functools import partial

from desplat_ns.tools.commands import run
from desplat_ns.tools.process.request import Request

main = partial(run, Request, description=__doc__)
