"""OpenSim's inverse kinematics of a file of markers, as a program of a Python that has the module opensim: it imports
none of our code.

    PYTHON opensim_ik.py JOB.json RESULT.json

The job: `model` (.osim), `points` (.trc), `weights` by marker, `clamped`: whether coordinates keep to their ranges,
`accuracy` of the solver. The result: `coordinates`, their `names`, `low` and `high` (degrees, metres; none where the
model has no limits), `values` (T, N), `places` (T, M, 3) of the markers in the ground [m], and `seconds` of processor
time of every frame; the first one assembles the model.
"""

from __future__ import annotations

import json
import math
import sys
from importlib import import_module
from pathlib import Path
from time import process_time
from typing import Any

_TURNS = 1  # kind of motion of a coordinate


def solve_job(job_file: str, result_file: str) -> None:
    """Read the job, do it, write the result."""
    job = json.loads(Path(job_file).read_text(encoding="utf-8"))
    Path(result_file).write_text(json.dumps(solved(import_module("opensim"), job)), encoding="utf-8")


def solved(opensim: Any, job: dict[str, Any]) -> dict[str, Any]:
    """The result of a job."""
    opensim.Logger.setLevelString("Error")
    model = opensim.Model(job["model"])
    coordinates = [model.getCoordinateSet().get(i) for i in range(model.getCoordinateSet().getSize())]
    limited = [coordinate.getDefaultClamped() for coordinate in coordinates]
    for coordinate, within in zip(coordinates, limited):  # noqa: B905, of one length
        coordinate.setDefaultClamped(within and job["clamped"])
    state = model.initSystem()
    solver, times = _solver(opensim, model, job)
    markers = [model.getMarkerSet().get(name) for name in job["weights"]]
    values, places, seconds = [], [], []
    for i, time in enumerate(times):
        state.setTime(time)
        begin = process_time()
        (solver.track if i else solver.assemble)(state)
        seconds.append(process_time() - begin)
        model.realizePosition(state)
        values.append([c.getValue(state) * _unit(c) for c in coordinates])
        where = [marker.getLocationInGround(state) for marker in markers]
        places.append([[place.get(axis) for axis in range(3)] for place in where])
    return {
        "names": [c.getName() for c in coordinates],
        "low": [c.getRangeMin() * _unit(c) if within else None for c, within in zip(coordinates, limited)],  # noqa: B905
        "high": [c.getRangeMax() * _unit(c) if within else None for c, within in zip(coordinates, limited)],  # noqa: B905
        "markers": list(job["weights"]), "values": values, "places": places, "seconds": seconds,
        "version": opensim.GetVersion(),
    }  # fmt: skip


def _solver(opensim: Any, model: Any, job: dict[str, Any]) -> tuple[Any, list[float]]:
    """The solver, and the times of the file's frames."""
    weights = opensim.SetMarkerWeights()
    for name, weight in job["weights"].items():
        weights.cloneAndAppend(opensim.MarkerWeight(name, weight))
    markers = opensim.MarkersReference(job["points"], weights)
    coordinates = opensim.SimTKArrayCoordinateReference()
    solver = opensim.InverseKinematicsSolver(model, markers, coordinates, math.inf)
    solver.setAccuracy(job["accuracy"])
    return solver, list(opensim.TimeSeriesTableVec3(job["points"]).getIndependentColumn())


def _unit(coordinate: Any) -> float:
    return 180.0 / math.pi if coordinate.getMotionType() == _TURNS else 1.0


if __name__ == "__main__":
    solve_job(*sys.argv[1:])
