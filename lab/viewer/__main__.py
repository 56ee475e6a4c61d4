"""Fetches the pinned libraries by npm, bundles them, and writes the package's viewer.

    python -m lab.viewer

Needs node and npm. Nothing is written where a library or the bundle is not what `pins.json` says;
`--repin` takes over what came out, after a version in `pins.json` was changed.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
PINS = HERE / "pins.json"
ENTRY = HERE / "entry.js"
OUTPUT = HERE.parents[1] / "desplat_ns" / "scene" / "viewer"

BUNDLER = "esbuild"
ESBUILD = ("--bundle", "--minify", "--format=iife", "--global-name=Viewer", "--target=es2020")

EMBEDDED = re.compile(r'decode64\("([A-Za-z0-9+/=]+)"\)')
"""Spark's WebAssembly as it stands in its source. Beside the script, not in it, it is compressed to
half of that, and no browser has to read two megabytes of text as a program."""

GIVEN = "globalThis.SPARK_WASM"
"""Where the page puts it, as bytes."""

BUILD_PATHS = re.compile(rb"/Users/\w+/|index\.[a-z]+\.io")
"""In messages of the WebAssembly: folders and hosts of the machine that compiled it."""


def fetch(folder: Path, pins: dict[str, Any]) -> dict[str, str]:
    """Install the pinned versions; the checksum that npm checked for each of them."""
    wanted = [f"{name}@{package['version']}" for name, package in pins["packages"].items()]
    (folder / "package.json").write_text('{"private": true}')
    quiet = ("--ignore-scripts", "--no-audit", "--no-fund", "--loglevel=error", "--save-exact")
    subprocess.run(["npm", "install", *quiet, *wanted], cwd=folder, check=True)
    locked = json.loads((folder / "package-lock.json").read_text())["packages"]
    return {name: locked[f"node_modules/{name}"]["integrity"] for name in pins["packages"]}


def bundled(folder: Path) -> dict[str, bytes]:
    """The files of the viewer, by name."""
    modules = folder / "node_modules"
    spark = modules / "@sparkjsdev" / "spark" / "dist" / "spark.module.js"
    text = spark.read_text()
    match = EMBEDDED.search(text)
    assert match is not None, "Spark embeds its WebAssembly in another way now"
    spark.write_text(text.replace(match[0], GIVEN))
    shutil.copy(ENTRY, folder)
    out = folder / "viewer.js"
    options = (*ESBUILD, "--legal-comments=none", f"--outfile={out}", "--log-level=error")
    program = modules / BUNDLER / "bin" / "esbuild"
    subprocess.run(["node", program, folder / ENTRY.name, *options], check=True)
    wasm = BUILD_PATHS.sub(lambda path: b"-" * len(path[0]), base64.b64decode(match[1]))
    return {
        "viewer.js.gz": gzip.compress(out.read_bytes(), mtime=0),
        "spark.wasm.gz": gzip.compress(wasm, mtime=0),
        "LICENSES.txt": licences(modules).encode(),
    }


def licences(modules: Path) -> str:
    """Whose work is in the bundle, and under which terms."""
    parts = ["The files beside this one are built from the work of others (make viewer).\n"]
    for name in ("@sparkjsdev/spark", "three", "fflate"):
        version = json.loads((modules / name / "package.json").read_text())["version"]
        parts.append(f"{name} {version}\n\n{(modules / name / 'LICENSE').read_text().strip()}\n")
    return ("\n" + "-" * 80 + "\n\n").join(parts)


def checksum(name: str, content: bytes) -> str:
    """SHA-256 of a file; of a compressed one, of what is inside: zlibs compress differently."""
    plain = gzip.decompress(content) if name.endswith(".gz") else content
    return hashlib.sha256(plain).hexdigest()


def main() -> None:
    pins = json.loads(PINS.read_text())
    with tempfile.TemporaryDirectory() as place:
        checksums = fetch(Path(place), pins)
        files = bundled(Path(place))
    fresh = {
        "packages": {
            name: {"version": package["version"], "integrity": checksums[name]}
            for name, package in pins["packages"].items()
        },
        "files": {name: checksum(name, content) for name, content in files.items()},
    }
    if "--repin" in sys.argv[1:]:
        PINS.write_text(json.dumps(fresh, indent=2) + "\n")
    elif fresh != pins:
        sys.exit(f"What came is not what {PINS} says:\n{json.dumps(fresh, indent=2)}")
    OUTPUT.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (OUTPUT / name).write_bytes(content)
        print(f"{OUTPUT / name}: {len(content):,} bytes")


if __name__ == "__main__":
    main()
