"""A server on this machine that serves a file, breaks off or lies about its size."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread


@dataclass
class Site:
    """One file, and how it is served."""

    content: bytes
    breaks_after: list[int] = field(default_factory=list)
    """Bytes after which the next answers break off; then none does."""
    claims_more: int = 0
    """Bytes that answers promise beyond what they bring."""
    ranges: bool = True
    is_busy: int = 0
    """Answers that it has no time for."""
    asked: list[str | None] = field(default_factory=list)
    """The ranges that were asked for."""
    address: str = ""


@contextmanager
def serving(site: Site) -> Iterator[Site]:
    """Within, `site.address` is served."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked = self.headers.get("Range")
            site.asked.append(asked)
            if site.is_busy:
                site.is_busy -= 1
                self.send_error(503)
                return
            if not self.path.startswith("/data."):
                self.send_error(404)
                return
            start = 0
            if asked and site.ranges:
                start = int(asked.removeprefix("bytes=").rstrip("-"))
            if start >= len(site.content) > 0 and start:
                self.send_error(416)
                return
            rest = site.content[start:]
            self.send_response(206 if start else 200)
            if start:
                self.send_header("Content-Range", f"bytes {start}-{len(site.content) - 1}/*")
            self.send_header("Content-Length", str(len(rest) + site.claims_more))
            self.end_headers()
            self.wfile.write(rest[: site.breaks_after.pop(0)] if site.breaks_after else rest)

        def log_message(self, format: str, *args: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = Thread(target=server.serve_forever, daemon=True)
    thread.start()
    site.address = f"http://127.0.0.1:{server.server_port}/data.zip"
    try:
        yield site
    finally:
        server.shutdown()
        server.server_close()
        thread.join()
