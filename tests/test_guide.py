"""The guide's commands and programs, run as they stand there, and its pages as a site without a warning."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.support.common import ROOT
from kinemode import __main__ as front
from tests.made_once import made_once
from tests.tiers import later

DOCS = ROOT / "docs"
PAGES = ("first-clip", "uncertainty", "opensim", "several-cameras", "own-robot", "your-video")
SECONDS = re.compile(r"--seconds [0-9.]+")
BLOCK = re.compile(r"^```(sh|python)\n(.*?)^```", re.MULTILINE | re.DOTALL)


@pytest.fixture
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the first page has made, which the others use."""

    def first_page(empty: Path) -> Path:
        follow(PAGES[0], empty)
        return empty

    return made_once(tmp_path_factory, "guide", first_page)


def follow(page: str, folder: Path) -> None:
    """Do what a page says, all of it in this process, and of shorter clips: what takes long is the same frame after
    frame."""
    blocks = BLOCK.findall((DOCS / "guide" / f"{page}.md").read_text(encoding="utf-8"))
    assert blocks
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for kind, text in blocks:
            if kind == "python":
                exec(compile(text, f"{page}.md", "exec"), {"__name__": "__main__"})
                continue
            for line in text.splitlines():
                program, *words = shlex.split(SECONDS.sub("--seconds 0.1", line))
                assert program == "kinemode"
                assert front.main(words) == 0, line


@pytest.mark.parametrize("page", later(PAGES, "own-robot"))
def test_what_a_page_says_works(page: str, folder: Path) -> None:
    if page != PAGES[0]:  # that is done already
        follow(page, folder)
    assert (folder / "reach.run").exists()


def test_the_site_is_built_without_a_warning(tmp_path: Path) -> None:
    pytest.importorskip("sphinx", reason="Sphinx is not installed")
    line = ["-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", str(DOCS), str(tmp_path)]
    ended = subprocess.run([sys.executable, *line], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    pages = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.html")}
    assert {f"{path.relative_to(DOCS).with_suffix('').as_posix()}.html" for path in DOCS.rglob("*.md")} <= pages
