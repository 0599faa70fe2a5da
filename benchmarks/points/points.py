"""Tracks of points in space: errors against captured motion, a laboratory and OpenSim, and processor time."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from threadpoolctl import threadpool_limits

from benchmarks.points.captured_errors import measure_captured
from benchmarks.points.captured_trials import CLIPS, FPS, SET, MarkerFaults, captured_trial
from benchmarks.points.four_cameras import measure_cameras
from benchmarks.points.frame_time import measure_frame_time
from benchmarks.points.laboratory import LABORATORY, OWN, TRIALS, measure_laboratory
from benchmarks.points.opensim_side import measure_opensim, python_with_opensim
from benchmarks.points.tracked_points import fit_of, observations_of
from benchmarks.support.common import Data, Json, Several, Work, check_known, data_folder, save, work_folder
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.flags import Flag

_STATIC = "static1"
MISSING = {
    "opencap": f"the data has no {LABORATORY}",
    "opensim": "this Python has no opensim, and --opensim-python names no other",
    "captured": "the data has no mocap", "speed": "the data has no mocap", "cameras": "the data has no beam4cam",
}  # fmt: skip
_ANYWHERE = "--data DIR or KINEMODE_DATA names the folder that has it"


def main(
    *,
    opencap: Flag = False,
    opensim: Flag = False,
    captured: Flag = False,
    speed: Flag = False,
    cameras: Flag = False,
    clips: Annotated[tuple[str, ...], Several] = CLIPS,
    seeds: Annotated[tuple[int, ...], Several] = (0,),
    fits: Annotated[tuple[str, ...], Several] = (OWN,),
    seconds: float = 3.0,
    places: float = 10.0,
    static: float | None = None,
    opensim_python: Path | None = None,
    data: Data = None,
    work: Work = None,
    json: Json = None,
) -> None:
    """Track human34 from markers. Without a flag all parts for which the data is here.

    Parameters
    ----------
    opencap
        Laboratories' trials of several people against their own inverse kinematics, and whether its angles lie in
        the bands of ours.
    opensim
        OpenSim's inverse kinematics on the same body, markers and weights.
    captured
        Captured motion on people of random proportions, with noise, outliers and gaps: angles, lengths, bands.
    speed
        Processor time of a frame with 39 markers, one hypothesis, without smoothing.
    cameras
        Four cameras' keypoints, triangulated and tracked as points, beside the same keypoints.
    clips
        Of --captured.
    seeds
        Of people, noise and tracker; of other parts than --captured the first.
    fits
        Of --opencap: trials that its first person is fitted on, own for each trial itself.
    seconds
        Of each trial: the middle of a laboratory's, the beginning of captured motion.
    places
        Of --captured: RMS distance of the markers from where their set has them [mm].
    static
        Of --captured: the person is fitted on a static trial besides, of 1 s, standing upright but for random
        deviations of the joints of so many degrees.
    opensim_python
        A Python that has the module opensim, where this has not.
    """
    check_known("--clips", clips, CLIPS)
    check_known("--fits", fits, (OWN, _STATIC, *TRIALS))
    flags = {"opencap": opencap, "opensim": opensim, "captured": captured, "speed": speed, "cameras": cameras}
    shared = data_folder(data)
    if shared is None:
        raise InputError("data", "the evaluation data is not here", remedy=_ANYWHERE)
    faults, first = MarkerFaults(places=1e-3 * places, standing=static), seeds[0]
    python = python_with_opensim(opensim_python)
    laboratory, mocap, beam = shared / LABORATORY, shared / "mocap", shared / "beam4cam"
    parts: dict[str, tuple[object, Callable[[Path], dict[str, Any]]]] = {
        "opencap": (laboratory.is_dir(), lambda place: measure_laboratory(shared, place, fits, seconds, first)),
        "opensim": (python, lambda place: measure_opensim(shared, place, python, seconds, first)),
        "captured": (mocap.is_dir(), lambda place: measure_captured(mocap, place, faults, clips, seeds, seconds)),
        "speed": (mocap.is_dir(), lambda place: measure_speed(mocap, place, seconds, first)),
        "cameras": (beam.is_dir(), lambda place: measure_cameras(beam, place, first)),
    }
    figures: dict[str, Any] = {"measure": "points"}
    with work_folder(work) as place, threadpool_limits(limits=1):
        for name, (there, measure) in parts.items():
            if any(flags.values()) and not flags[name]:
                continue
            if there:
                figures[name] = measure(place)
            else:
                print(f"{name}: {MISSING[name]}, so it is not measured")
    save(json, figures)


def measure_speed(mocap: Path, work: Path, seconds: float, seed: int) -> dict[str, Any]:
    """The speed for a person fitted on the start of a captured walk."""
    trial = captured_trial(mocap / f"{CLIPS[0]}.bvh", seed, MarkerFaults(), seconds, FPS)
    path = trial.write(work / "speed.trc")
    fit = fit_of(load_subject("human34"), path, seed=seed, markers=SET)
    return measure_frame_time(*observations_of(fit.subject, path), seed)
