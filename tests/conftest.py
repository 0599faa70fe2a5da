"""What the tests share."""

from __future__ import annotations

import gc
import os
import sys

# as `kinemode.track` does: for matrices of this size threaded linear algebra is several times slower
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when numpy is imported
# hundreds of processes are started, and would compile every source again where bytecode is not kept
if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):
    sys.dont_write_bytecode = False
if sys.__stdin__ is None:  # started with it closed, which IPython, that meshcat imports, cannot do with
    sys.stdin = sys.__stdin__ = open(os.devnull)  # type: ignore[misc]  # noqa: SIM115

from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.made_once import made_once

ROOT = Path(__file__).resolve().parent.parent


LONGEST = (
    "start_by_index", "elmo", "tracker_contract", "resume", "loose_limbed", "eigen_templates",
    "trackers", "calibrate", "pose_chain", "guide", "preview_page", "viz", "live",
)  # fmt: skip
"""Test files with the longest tests or fixtures: they start first, so that no process is left with one at the end."""


def pytest_collect_directory(path: Path, parent: pytest.Collector) -> pytest.Dir | None:
    """The second process begins with the last file: of files that are new, each process rewrites the assertions of
    half, and reads what the other has rewritten."""
    return LastFirst.from_parent(parent, path=path) if os.environ.get("PYTEST_XDIST_WORKER") == "gw1" else None


class LastFirst(pytest.Dir):
    """A folder whose last file is collected first."""

    def collect(self) -> Iterable[pytest.Item | pytest.Collector]:
        return reversed(list(super().collect()))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest first, in the order of names otherwise, which is the same in all processes."""
    items.sort(key=lambda item: (item.path.stem.removeprefix("test_") not in LONGEST, item.path))


def pytest_collection_finish() -> None:
    """Modules and tests live to the end: the garbage collector need not scan them repeatedly."""
    gc.freeze()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The evaluation data: the folder in KINEMODE_DATA, or ../shared/data next to the checkout."""
    given = os.environ.get("KINEMODE_DATA")
    folder = Path(given) if given else ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip(f"no evaluation data at {folder}: set KINEMODE_DATA")
    return folder


@pytest.fixture
def default_signals() -> Iterator[None]:
    """SIGINT, SIGTERM and SIGHUP do what they do by default, however the suite was started."""
    from tests import waiting

    with waiting.default_signals():
        yield


MOST_SCALED = 200


@pytest.fixture(scope="session", autouse=True)
def scaled_once() -> Iterator[None]:
    """Subjects that are scaled alike, as every fit scales each proportion of human34, are made once; none changes."""
    from humanoid.subject.subject import Subject  # every other test imports it anyway

    plain = Subject.scaled
    kept: OrderedDict[Any, Subject] = OrderedDict()

    def scaled(self: Subject, scales: Mapping[str, float]) -> Subject:
        asked = self.urdf, self.source, self.base, self.notes, tuple(scales.items())
        if asked not in kept:
            kept[asked] = plain(self, scales)
            while len(kept) > MOST_SCALED:
                kept.popitem(last=False)
        return kept[asked]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Subject, "scaled", scaled)
        yield


@pytest.fixture(scope="session")
def facts(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """What `tests.sources` reads from every source file (Mapping[Path, Facts])."""
    from tests.sources import facts_of_all

    return made_once(tmp_path_factory, "sources", lambda _: facts_of_all())


@pytest.fixture
def few_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports draw the first two joints alone, where nothing is asked of the others."""
    from viz.report import pictures

    every = pictures.panels_of
    monkeypatch.setattr(pictures, "panels_of", lambda angles: every(angles)[:2])


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Selenium's driver of a headless Chromium."""
    pytest.importorskip("selenium.webdriver", reason="selenium is not installed")
    from benchmarks.support.browser import opened_browser, programs

    if programs() is None:
        pytest.skip("Chromium and its chromedriver are not installed")
    with opened_browser(tmp_path_factory.mktemp("profile")) as driver:
        yield driver


@pytest.fixture(scope="session")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The clip of `tests.tiny_clip`; its files are never changed."""
    from tests.tiny_clip import tiny_clip  # many tests do not need it

    return made_once(tmp_path_factory, "tiny_clip", tiny_clip)


@pytest.fixture(scope="session")
def small_index(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """A small index of examples of human34."""

    def train(_: Path) -> Any:
        from estimator.search.examples.index import IndexRecipe
        from estimator.synthesis.training import train_index
        from humanoid.subject.subject import load_subject

        recipe = IndexRecipe(examples=250, headings=120.0, pairs=120, variants=2, tables=10, key_bits=12)
        return train_index(load_subject("human34"), recipe)

    return made_once(tmp_path_factory, "small_index", train)


@pytest.fixture(scope="session")
def small_index_file(small_index: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its file, which is never changed."""

    def save(folder: Path) -> Path:
        small_index.save(folder / "index.npz")
        return folder / "index.npz"

    return made_once(tmp_path_factory, "small_index_file", save)


@pytest.fixture(scope="session")
def valid(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, list[Mapping[str, bytes]]]:
    """Valid files of every kind, see `benchmarks.robustness.fuzz_corpus.corpus`; a run of one subject is among them."""

    def files(_: Path) -> Mapping[str, list[Mapping[str, bytes]]]:
        from benchmarks.robustness.fuzz_corpus import corpus  # no other test needs it

        return corpus(("arm8",))

    return made_once(tmp_path_factory, "valid", files)
