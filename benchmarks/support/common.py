"""Shared parts of the measures: data, clips, tables, JSON, and errors as one line."""

from __future__ import annotations

import json
import multiprocessing
import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, TypeVar

import cyclopts
import numpy as np
from cyclopts import Parameter

import kinemode as km
from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from kinemode.target import made_folder

Task = TypeVar("Task")
Result = TypeVar("Result")
ROOT = Path(__file__).resolve().parents[2]
CUES = ("edges", "flow", "silhouette")
"""The cues that the figures in the documents are of."""
NO_CAPTURE_HERE = "the motion capture is not here: --data DIR or KINEMODE_DATA names the folder that has mocap in it"
Several = Parameter(consume_multiple=True, negative="")
_DATA = "Folder with beam4cam, mocap and mocap_more; KINEMODE_DATA, or ../shared/data next to the checkout, by default."
Data = Annotated[Path | None, Parameter(help=_DATA)]
Clips = Annotated[tuple[str, ...], Several, Parameter(help="Names of BVH files there, without the ending.")]
Every = Annotated[bool, Parameter(name="--all", negative="", help="All of them.")]
Work = Annotated[Path | None, Parameter(help="Folder that keeps what is made; a temporary one unless given.")]
Json = Annotated[Path | None, Parameter(name="--json", help="Also write the figures here.")]
Changes = Annotated[tuple[str, ...], Parameter(name="--set", consume_multiple=True, negative="")]


def run(main: Callable[..., None], name: str, arguments: Sequence[str]) -> None:
    """Run a measure's `main` with the words of a command line; bad input is one line and exit code 2."""
    quiet()
    app = cyclopts.App(name=f"python -m benchmarks {name}", version_flags=())
    app.default(main)
    try:
        app(list(arguments))
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def quiet() -> None:
    """No warnings of input, in this process."""
    warnings.simplefilter("ignore", km.InputWarning)


def tell(text: str) -> None:
    """A line of progress."""
    print(text, file=sys.stderr, flush=True)


def in_processes(work: Callable[[Task], Result], tasks: Sequence[Task], jobs: int) -> list[Result]:
    """The results of `work`, a function of a module, for all tasks in order; so many of them at a time."""
    if jobs < 1:
        raise InputError("--jobs", f"is {jobs}", remedy="1 or more")
    if min(jobs, len(tasks)) < 2:
        return [work(task) for task in tasks]
    spawn = multiprocessing.get_context("spawn")  # a forked child would inherit threads that stand still
    with ProcessPoolExecutor(min(jobs, len(tasks)), spawn, quiet) as pool:
        return list(pool.map(work, tasks))


@contextmanager
def work_folder(given: Path | None) -> Iterator[Path]:
    """The given folder, made if it is not there, or a temporary one."""
    if given is not None:
        yield made_folder(given)
        return
    with tempfile.TemporaryDirectory(prefix="kinemode-") as folder:
        yield Path(folder)


def data_folder(given: Path | None) -> Path | None:
    """The evaluation data: the given folder, KINEMODE_DATA, or ../shared/data next to the checkout; None without."""
    folder = given or Path(os.environ.get("KINEMODE_DATA") or ROOT.parent / "shared" / "data")
    if folder.is_dir():
        return folder
    if given is not None:
        raise InputError(given, "no such folder")
    return None


def captured_folder(given: Path | None) -> Path | None:
    """The evaluation data if it has motion capture; otherwise None, with a message."""
    folder = data_folder(given)
    if folder is None or not (folder / "mocap").is_dir():
        print(NO_CAPTURE_HERE)
        return None
    return folder


def check_known(option: str, names: Iterable[str], known: Iterable[str]) -> None:
    """Raise InputError for the first of the names that is not known."""
    valid = list(known)
    for name in names:
        if name not in valid:
            raise InputError(option, f"there is no {name!r}", remedy=f"some of {', '.join(valid)}")


def beam_folder(given: Path | None) -> Path:
    """The clip `beam4cam` of the evaluation data; raises InputError where it is absent."""
    folder = data_folder(given)
    if folder is None or not (folder / "beam4cam" / "reference3d.npz").is_file():
        remedy = "--data DIR or KINEMODE_DATA names the folder that has it"
        raise InputError("beam4cam", "the evaluation clip is not here", remedy=remedy)
    return folder / "beam4cam"


def nested(changes: Sequence[str]) -> dict[str, Any]:
    """`group.name=value` texts as nested settings; values are JSON, anything else is text."""
    tables: dict[str, Any] = {}
    for change in changes:
        path, separator, text = change.partition("=")
        if not separator:
            raise InputError("--set", f"{change!r} has no value", remedy="write group.name=value, as cost.nu=8")
        *groups, name = path.split(".")
        place = tables
        for group in groups:
            place = place.setdefault(group, {})
        try:
            place[name] = json.loads(text)
        except json.JSONDecodeError:
            place[name] = text
    return tables


def save(path: Path | None, figures: dict[str, Any]) -> None:
    """Write the figures as JSON, if a file was given; non-finite numbers become null."""
    if path is not None:
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(_plain(figures), indent=1, allow_nan=False) + "\n")
        print(f"figures: {path}")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def spread(values: Sequence[float]) -> str:
    """Median, and the range where there are several."""
    middle = f"{np.median(values):.1f}"
    return middle if len(values) < 2 else f"{middle} ({min(values):.1f} to {max(values):.1f})"
