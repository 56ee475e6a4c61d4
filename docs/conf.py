"""The site made of these pages: `make docs`. GitHub shows them as they are.

Pages are grouped by docs/README.md: each heading there is a group, each link below it a page of it.
A page that no group names, a link that leads nowhere and a picture that is not there are errors.
"""

import re
from pathlib import Path

HERE = Path(__file__).resolve().parent

project = "desplat-ns"
copyright = "the desplat-ns authors, Apache-2.0"
extensions = ["myst_parser"]
root_doc = "README"
exclude_patterns = ["records"]
html_theme = "furo"
html_title = "desplat-ns"
html_css_files = ["site.css"]
html_static_path = ["_static"]
html_extra_path = ["scene.html"]
html_show_sphinx = False
html_copy_source = False
myst_heading_anchors = 4
nitpicky = True

BESIDE = re.compile(r"\[([^\]]+)\]\((?:\.\./)+(?:README|CONTRIBUTING|CHANGELOG)\.md(?:#[\w-]+)?\)")
"""Links to pages of the repository that are not part of the site."""


def groups(index: str) -> list[tuple[str, list[str]]]:
    """Headings of the index, each with its pages, in their order."""
    found = []
    for part in re.split(r"^## ", index, flags=re.MULTILINE)[1:]:
        title, _, text = part.partition("\n")
        pages = re.findall(r"\]\(([\w/-]+)\.md\)", text)
        found.append((title.strip(), list(dict.fromkeys(pages))))
    return found


def with_contents(app, docname, source) -> None:
    """Give the index its hidden tables of contents; name without a link what lies beside docs/."""
    source[0] = BESIDE.sub(r"\1 (in the repository)", source[0])
    if docname == root_doc:
        for title, pages in groups(source[0]):
            listed = "\n".join(pages)
            source[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n{listed}\n```\n"


def lead_to_the_index(app, failure) -> None:
    """index.html, which servers show for a folder."""
    if failure is None:
        page = '<!doctype html><meta http-equiv="refresh" content="0; url=README.html">\n'
        Path(app.outdir, "index.html").write_text(page, "utf8")


def setup(app) -> None:
    """What Sphinx calls."""
    app.connect("source-read", with_contents)
    app.connect("build-finished", lead_to_the_index)
