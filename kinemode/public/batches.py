"""`batch`: many clips by one call, on this machine or several."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from humanoid.support.errors import InputError
from kinemode import kinds
from kinemode.batches.manifest import read_manifest, rows_of
from kinemode.batches.outcome import ClipOutcome
from kinemode.making_requests import BatchRequest
from kinemode.named import PathLike
from kinemode.notices import warn
from kinemode.option import takes
from viz.report.thumbnail import DONE


@dataclass(frozen=True)
class Batch:
    """The outcomes of a batch's clips.

    Attributes
    ----------
    folder: where everything is; clips/NAME/NAME.run are the runs.
    outcomes: by the names of the clips, in the order of the manifest.
    table, page: the CSV file and the page of all clips, None where it could not be written.
    """

    folder: Path
    outcomes: Mapping[str, ClipOutcome]
    table: Path | None
    page: Path | None

    @property
    def failed(self) -> dict[str, str]:
        """Why clips failed, by name."""
        return {name: outcome.message for name, outcome in self.outcomes.items() if outcome.status != DONE}


@takes(BatchRequest)
def batch(request: BatchRequest) -> Batch:
    """Track many clips, each as `kinemode.track` does; finished clips are not done again by the same call.

    A clip that fails stops no other. The results of a clip are kept as long as its options and the content of its
    files are the same. A person that several rows name is fitted once, from the first clip or that whose `fits` is set
    so. Every clip is worked on by one thread, and its run is that of a single `track`.

    Parameters
    ----------
    OPTIONS

    A script needs `if __name__ == "__main__":` around what it runs.

    Raises
    ------
    ManifestError: with all faults of the manifest, before any clip is tracked.
    InputError: other invalid arguments; another batch in the folder; a scheduler that cannot be reached, or
        whose workers have other versions.
    """
    manifest, formats = request.manifest, _formats(request.export)
    rows = read_manifest(manifest) if isinstance(manifest, (str, os.PathLike)) else rows_of(manifest)
    from kinemode.batches.engines import engine_of
    from kinemode.batches.leader import PAGE, TABLE, BatchPlan, Leader, opened_root
    from kinemode.batches.shown import ShownBatch

    root = Path(request.out).absolute()
    plan = BatchPlan(rows, root, formats, request.report)
    title = Path(manifest).name if isinstance(manifest, (str, os.PathLike)) else root.name
    outcomes: dict[str, ClipOutcome] = {}
    with opened_root(root) as token, engine_of(request.engine, request.workers, request.scheduler) as crew:
        shown, reporter = ShownBatch(rows, root, title), request.reporter

        def keep(outcome: ClipOutcome) -> None:
            outcomes[outcome.name] = outcome
            shown.put(outcome)

        try:
            leader = Leader(plan, crew, token, keep)
            leader.prepare(reporter)
            with reporter("clips") as reported:
                leader.run(lambda: reported(len(outcomes), len(rows)))
        except KeyboardInterrupt as stop:
            done = f"{len(outcomes)} of {len(rows)} clips are done, and what was tracked of others is kept"
            raise KeyboardInterrupt(f"interrupted; {done}: the same command resumes it") from stop
        finally:
            faults = shown.write()
            for full in faults.values():  # the outcomes of the clips are returned nevertheless
                warn(str(full))
    table, page = (None if name in faults else root / name for name in (TABLE, PAGE))
    return Batch(root, {row.name: outcomes[row.name] for row in rows}, table, page)


def make_manifest(folder: PathLike, out: PathLike, *, overwrite: bool = False) -> list[dict[str, str]]:
    """Write a manifest for `kinemode.batch` of the clips in a folder and below it, and return its rows.

    What is guessed and what could not be placed is reported in warnings; clips without keypoints are to be detected.

    Parameters
    ----------
    folder: of videos beside each other, or in folders of one or several cameras; of sessions of Pose2Sim or OpenCap.
    out: the CSV file. overwrite: replace it if it is there.

    Raises
    ------
    InputError: no folder, no clip in it, a file that cannot be written.
    """
    kinds.check(folder=(folder, kinds.FILE), out=(out, kinds.FILE), overwrite=(overwrite, kinds.FLAG))
    from kinemode.batches.folders import manifest_of, write_manifest

    made = manifest_of(folder)
    write_manifest(made, out, overwrite=overwrite)
    for sentence in made.left_out:
        warn(sentence)
    return made.rows(Path(out).absolute().parent)


def _formats(export: str | Iterable[str]) -> tuple[str, ...]:
    """Names of existing formats, each once."""
    named = export.split(",") if isinstance(export, str) else list(export)
    names = tuple(dict.fromkeys(name.strip().lstrip(".") for name in named if name.strip()))
    if not names:
        return ()
    import viz.exporters  # noqa: F401 - registers those that show the body
    from estimator.runs.export import EXPORTERS

    for name in names:
        if name not in EXPORTERS:
            raise InputError("export", f"{name!r} is unknown", remedy=f"some of {', '.join(sorted(EXPORTERS))}")
    return names
