"""How the documentation becomes a site: `make docs`, which fails on any warning."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent))

import generate

project = "kinemode"
copyright = "the kinemode authors"
extensions = ["myst_parser"]
html_theme = "furo"
html_title = "kinemode"
html_show_sphinx = False
html_copy_source = False
exclude_patterns = ["site"]
smartquotes = False  # they would turn the two hyphens of an option into a dash
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4  # links into pages use GitHub's anchors, so that they work there too

REFERENCE = {f"reference/{name}": write for name, write in generate.PAGES.items()}


def setup(app: Any) -> None:
    """The reference pages get what the code says, in every build anew."""
    app.connect("source-read", _add_reference)
    app.connect("env-get-outdated", lambda *_: list(REFERENCE))


def _add_reference(app: Any, page: str, source: list[str]) -> None:
    if page in REFERENCE:
        source[0] = f"{source[0].rstrip()}\n\n{REFERENCE[page]()}\n"
