"""The structure that a reader and a change pass through: modules and lines, the files that an observation crosses
within a frame of css, and the files that mention an option."""

from __future__ import annotations

import ast
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType, FunctionType
from typing import Any

import kinemode as km
from benchmarks.support.common import ROOT, Json, save, tell, work_folder
from estimator.data.observation import Observation
from estimator.search.cost_terms import TERMS
from estimator.tracking.runner import FrameByFrame
from kinemode.option import options_of
from kinemode.request import TrackRequest

PACKAGES = ("humanoid", "estimator", "viz", "kinemode")
MOST_CROSSED, MOST_KNOWING = 8, 4
_FRAME = 5  # the frame of the clip in which files are counted: the first ones begin
_CARRIERS = frozenset({"request", "files", "wanted", "options", "asked"})
"""Names of variables that hold a request."""


def main(*, json: Json = None) -> None:
    """Count modules, lines, folders, files that are handed the observation, and files that use each option."""
    counts = {package: counted(ROOT / package) for package in PACKAGES}
    for name, (modules, lines, folders) in (*counts.items(), ("all", total(counts))):
        tell(f"{name}: {modules} modules, {lines} lines, {folders} folders")
    crossed = observation_files()
    terms = term_files()
    others = [file for file in crossed if file not in terms]
    tell(f"an observation crosses {len(others)} files (at most {MOST_CROSSED}): {', '.join(others)}")
    tell(f"and {len(crossed) - len(others)} that registered terms are made in")
    knowing = {name: option_files(name) for name in options_of(TrackRequest)}
    most = max(knowing, key=lambda name: len(knowing[name]))
    usual = sorted(map(len, knowing.values()))[len(knowing) // 2]
    tell(f"an option is known to {usual} files (median, at most {MOST_KNOWING}); {most}: {', '.join(knowing[most])}")
    save(json, {"counts": counts, "crossed": crossed, "terms": sorted(terms), "options": knowing})


def counted(folder: Path) -> tuple[int, int, int]:
    """Modules, lines that are not blank, and folders with modules below a folder."""
    paths = list(folder.rglob("*.py"))
    lines = sum(1 for path in paths for line in path.read_text(encoding="utf-8").splitlines() if line.strip())
    return len(paths), lines, len({path.parent for path in paths})


def total(counts: dict[str, tuple[int, int, int]]) -> tuple[int, int, int]:
    """The sums of all packages."""
    modules, lines, folders = (sum(each) for each in zip(*counts.values(), strict=True))
    return modules, lines, folders


def term_files() -> set[str]:
    """The files in which registered terms and what they are made by are defined."""
    makers: list[Any] = [source.make for source in TERMS.values()]
    return {file for make in makers for file in _called_in(make.__code__, make.__globals__)}


def _called_in(code: CodeType, names: dict[str, Any]) -> Iterator[str]:
    """The files of functions of `estimator.energy` that a function calls by their names."""
    for name in code.co_names:
        if isinstance(value := names.get(name), FunctionType):
            file = _relative(value.__code__.co_filename)
            if file.startswith("estimator/energy"):
                yield file


def observation_files() -> list[str]:
    """Files with a function that is handed the observation in one frame of css, in the order of the first calls; its
    own file apart."""
    seen: dict[str, None] = {}

    def watch(frame: FrameType, event: str, _: Any) -> None:
        if event != "call" or not frame.f_code.co_filename.startswith(str(ROOT)):
            return
        arguments = frame.f_code.co_varnames[: frame.f_code.co_argcount]
        if any(isinstance(frame.f_locals.get(name), Observation) for name in arguments):
            seen.setdefault(_relative(frame.f_code.co_filename))

    with work_folder(None) as folder, warnings.catch_warnings(), _watched(watch):
        warnings.simplefilter("ignore")
        clip = km.render(folder, "reach", fps=15, seconds=0.6, videos=False)
        (keypoints,) = clip.keypoints.values()
        km.track("human34", keypoints=keypoints, cameras=clip.cameras, fit="off", cues="off")
    return [file for file in seen if file != _relative(sys.modules[Observation.__module__].__file__ or "")]


@contextmanager
def _watched(watch: Any) -> Iterator[None]:
    """Within it calls in the frame `_FRAME` of a track are watched."""
    push, count = FrameByFrame.push, 0

    def counted_push(self: FrameByFrame, observation: Observation) -> Any:
        nonlocal count
        count += 1
        if count != _FRAME + 1:
            return push(self, observation)
        sys.setprofile(watch)
        try:
            return push(self, observation)
        finally:
            sys.setprofile(None)

    FrameByFrame.push = counted_push  # type: ignore[method-assign]
    try:
        yield
    finally:
        FrameByFrame.push = push  # type: ignore[method-assign]


def option_files(name: str) -> list[str]:
    """Files that read an option from a request, besides the one that declares it."""
    return [_relative(str(path)) for path in sorted((ROOT / "kinemode").rglob("*.py")) if _reads(path, name)]


def _reads(path: Path, name: str) -> bool:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Attribute) and node.attr == name:
            holder = node.value.attr if isinstance(node.value, ast.Attribute) else getattr(node.value, "id", "")
            if holder in _CARRIERS:
                return True
    return False


def _relative(path: str) -> str:
    return Path(path).resolve().relative_to(ROOT).as_posix() if path.startswith(str(ROOT)) else path
