"""The formats of runs that show the body, beside those of `estimator.runs.export`."""

from __future__ import annotations

from pathlib import Path

from estimator.runs.export import Writer
from estimator.runs.run_reader import Run


def _glb(run: Run, path: Path, name: str) -> None:
    from viz.gltf import write_glb

    write_glb(run, path)


def _rrd(run: Run, path: Path, name: str) -> None:
    from viz.rerun_file import write_rrd

    write_rrd(run, path)


FORMATS: dict[str, Writer] = {"glb": _glb, "rrd": _rrd}
"""Writers by format name, see `estimator.runs.export.FORMATS`."""
