"""A batch of many clips: what several processes gain, what kills and broken clips leave, what it costs beside the
clips, and whether memory grows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.robustness.batch_engines import measure_engines
from benchmarks.robustness.batch_kills import measure_kills
from benchmarks.robustness.batch_overhead import measure_overhead
from benchmarks.robustness.batch_soak import measure_many, measure_soak
from benchmarks.support.common import Json, Work, save, work_folder
from humanoid.support.errors import InputError
from kinemode.flags import Flag
from kinemode.target import made_folder

CLIPS, MANY = 24, 200


def main(
    *,
    kill: Flag = False,
    overhead: Flag = False,
    soak: Flag = False,
    many: Flag = False,
    clips: int | None = None,
    frames: int = 60,
    kills: int = 10,
    rows: int = 10_000,
    length: int = 10_000,
    window: int = 500,
    cues: str = "edges",
    settings: Path | None = None,
    seed: int = 0,
    work: Work = None,
    json: Json = None,
) -> None:
    """Batches of short rendered clips of keypoints by one process, by two and by two workers of Dask: time, and whether
    every run is that of a single call to the last bit. Or other parts, each by its flag.

    Parameters
    ----------
    kill
        Kill a worker in the middle, with one clip broken; then kill the batch itself at several moments and start it
        again.
    overhead
        Time and memory of a batch whose jobs do nothing.
    soak
        Memory and time a frame in one long clip with pictures.
    many
        Memory of the workers in a batch of many clips.
    clips
        24 unless given; of --many 200.
    frames
        Of a short clip.
    kills
        Of --kill.
    rows
        Of --overhead; and a tenth of them.
    length
        Frames of --soak.
    window
        Frames of --soak between two samples of memory.
    cues
        Of --soak.
    settings
        Of the tracker, a TOML file.
    seed
        Of the moments of --kill.
    """
    few = CLIPS if clips is None else clips
    parts: dict[str, tuple[bool, Callable[[Path], dict[str, Any]]]] = {
        "kill": (kill, lambda folder: measure_kills(folder, few, frames, kills, settings, seed)),
        "overhead": (overhead, lambda folder: measure_overhead(folder, rows)),
        "soak": (soak, lambda folder: measure_soak(folder, length, window, cues, settings)),
        "many": (many, lambda folder: measure_many(folder, MANY if clips is None else clips, frames, settings)),
    }
    wanted = {name: measure for name, (flag, measure) in parts.items() if flag}
    if not wanted:
        wanted["engines"] = lambda folder: measure_engines(folder, few, frames, settings)
    with work_folder(work) as place:
        figures = {name: measure(new_folder(place / name)) for name, measure in wanted.items()}
    save(json, {"measure": "batch", **figures})


def new_folder(folder: Path) -> Path:
    """The folder, made: a batch would find finished what is in it. Raises InputError where it is there."""
    if folder.exists():
        raise InputError(folder, "is there from another time", remedy="remove it, or name another --work")
    return made_folder(folder)
