"""The export formats that show the body, registered beside those of `estimator.runs.export`."""

from __future__ import annotations

from pathlib import Path

from estimator.runs.export import Exporter, register
from estimator.runs.run_reader import Run


def _glb(run: Run, path: Path, name: str) -> None:
    from viz.gltf import write_glb

    write_glb(run, path)


def _rrd(run: Run, path: Path, name: str) -> None:
    from viz.rerun_file import write_rrd

    write_rrd(run, path)


register(Exporter("glb", _glb, marks=False))
register(Exporter("rrd", _rrd))
