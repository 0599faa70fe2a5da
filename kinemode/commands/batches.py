"""The command of many clips."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from kinemode.flags import Flag

_SHOWN = 10  # clips that failed


def batch(
    manifest: Path | None = None,
    /,
    *,
    out: Path,
    make: Path | None = None,
    engine: Literal["processes", "dask"] = "processes",
    workers: int | None = None,
    scheduler: str | None = None,
    export: str = "",
    report: Flag = False,
    overwrite: Flag = False,
) -> None:
    """Track many clips: one row of a manifest each, several at a time, into one folder with a table and a page.

    The same command resumes a batch that was interrupted; clips that are finished are not done again unless their files
    or options have changed. --make FOLDER writes a manifest of the clips in a folder instead.

    Examples:

    kinemode batch --make recordings --out clips.csv

    kinemode batch clips.csv --out tracked --export csv,mot,trc --report

    kinemode batch clips.csv --out tracked --engine dask --scheduler tcp://192.168.0.5:8786

    Parameters
    ----------
    manifest
        A CSV or TOML file, a row for each clip: name, clips, keypoints, cameras, subject, person, detect, and any other
        option of `track`.
    out
        The folder for everything, with summary.csv and index.html; of --make the CSV file.
    make
        A folder of videos: one or several cameras a folder, sessions of Pose2Sim or OpenCap.
    engine
        processes of this machine, or dask: the workers of a scheduler that runs already.
    workers
        How many processes, each with one thread; as many as processors unless given.
    scheduler
        Address of Dask's scheduler.
    export
        Formats for every clip with commas between them, see `export`.
    report
        Write a report of every clip.
    overwrite
        With --make: replace the manifest if there is one.
    """
    import kinemode as km

    if make is not None:
        _make(manifest, make, out, overwrite)
        return
    if manifest is None:
        raise km.InputError("manifest", "is missing", remedy="name a CSV or TOML file, or --make FOLDER writes one")
    if overwrite:
        raise km.InputError("--overwrite", "is for --make", remedy="leave it out: what has changed is done anew")
    done = km.batch(
        manifest, out=out, engine=engine, workers=workers, scheduler=scheduler, export=export, report=report,
        progress=km.reported,
    )  # fmt: skip
    failed = done.failed
    page = "" if done.page is None else f": {done.page}"
    print(f"{len(done.outcomes) - len(failed)} of {len(done.outcomes)} clips tracked{page}")
    for name, why in list(failed.items())[:_SHOWN]:
        print(f"  {name}: {why}")
    if failed:
        remedy = "the table could not be written" if done.table is None else f"all of them are in {done.table}"
        raise km.InputError(manifest, f"{_counted(len(failed))} failed", remedy=remedy)


def _make(manifest: Path | None, folder: Path, out: Path, overwrite: bool) -> None:
    import kinemode as km

    if manifest is not None:
        raise km.InputError(manifest, "is not needed to make one", remedy="--make FOLDER --out MANIFEST")
    clips = km.make_manifest(folder, out, overwrite=overwrite)
    print(f"{_counted(len(clips))}: {out}")


def _counted(count: int) -> str:
    return "1 clip" if count == 1 else f"{count} clips"
