"""Targets of damaged files: every reader, as far as its result is used, with the kinds of damage."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import cache, cached_property, partial
from pathlib import Path
from random import Random

import numpy as np

from benchmarks.robustness.fuzz_arrays import mutated_npy, mutated_npz, mutated_run
from benchmarks.robustness.fuzz_corpus import FRAMES, SIZE, Files
from benchmarks.robustness.fuzz_hdf5 import mutated_hdf5
from benchmarks.robustness.fuzz_limbs import use_potentials, use_templates
from benchmarks.robustness.fuzz_mutations import mutated
from estimator.data.cameras.camera import guessed_camera
from estimator.data.formats.angle_files import read_motion_table
from estimator.data.formats.cameras import load_cameras
from estimator.data.formats.checked_json import read_json
from estimator.data.formats.keypoints import KeypointTrack, load_keypoints
from estimator.data.markers.load import load_points
from estimator.data.media.clip import Clip
from estimator.runs.reference_motion import Reference
from estimator.runs.run_file import RunWriter
from estimator.runs.run_reader import Run
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.motion_file import motion_of
from estimator.tracking.registry import make_tracker
from estimator.tracking.runner import stored_state
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from humanoid.kinematics.body import Body
from humanoid.limbs.graph import limb_graph
from humanoid.shape.solids import solids_of
from humanoid.subject.subject import load_subject
from kinemode.annotation.clicks import clicks_from_page, load_clicks, no_clicks
from kinemode.settings import read_settings


@dataclass(frozen=True)
class Reader:
    """kind: how its files are damaged. read: what is done with the file, or with the folder it is in (folder).
    share: of all inputs, smaller where reading takes long.
    """

    kind: str
    read: Callable[[Path], object]
    share: float
    folder: bool = False


def damaged(name: str, seeds: list[Files], random: Random) -> tuple[Files, str]:
    """A folder of files of which one is damaged, seldom another than the first, and the first one's name."""
    files = dict(random.choice(seeds))
    main, *rest = files
    victim = random.choice((main, main, main, *rest)) if not READERS[name].folder else random.choice((main, *rest))
    pool = [data for seed in seeds for data in seed.values()]
    files[victim] = _damage(READERS[name].kind, victim)(files[victim], random, pool)
    return files, main


def _damage(kind: str, name: str) -> Callable[[bytes, Random, list[bytes]], bytes]:
    if kind == "npz":
        return mutated_npz
    if kind == "run":
        return mutated_run
    if name.endswith(".h5"):
        return mutated_hdf5
    if name.endswith(".names.json"):
        kind = "json"
    if kind == "npy":
        return mutated_npy
    if name.endswith((".stl", ".png", ".jpg", ".bmp", ".mp4")):
        kind = "binary"
    return lambda data, random, others: mutated(data, kind, random, others)


def _bvh(path: Path) -> object:
    mocap = load_mocap(path)
    return mocap.at(np.linspace(0.0, mocap.seconds, 4))


def _motion(path: Path) -> object:
    """A table of joints, on the subject of its columns."""
    table = read_motion_table(path)
    name = "arm8" if "left_wrist_flexion" in " ".join(table.names) else "upper13"
    return motion_of(Body(load_subject(name)), table, np.linspace(0.0, 0.1, 4))


def _body(path: Path) -> object:
    body = Body(load_subject(path))
    posed = body.at(body.neutral)
    return body.landmarks(posed), solids_of(body, "visual"), solids_of(body)


def _landmark_file(path: Path) -> object:
    return _body(path.with_name("arm.urdf"))


def _limb_file(path: Path) -> object:
    return limb_graph(load_subject("arm8"), overrides=path)


def _run(path: Path) -> object:
    """All properties of a run."""
    run = Run.open(path)
    names = [n for n in dir(Run) if isinstance(getattr(Run, n), (cached_property, property)) and not n.startswith("_")]
    values = [getattr(run, name) for name in names]
    return values, list(run), [run.observation(i) for i in range(run.planned_count)]


def _state(path: Path) -> object:
    """The state from which a run resumes."""
    run = Run.open(path)
    writer, arrays, _ = RunWriter.resume(path, run.header)
    with writer:
        return stored_state(make_tracker(run.header.tracker, run.body), arrays, path)


def _clip(path: Path) -> object:
    with closing(Clip.open(path)) as clip:
        return clip.report, clip.frame(0)


def _folder(path: Path) -> object:
    return _clip(path.parent)


def _plate(path: Path) -> object:
    """A picture of the empty scene, of a clip that is the picture itself."""
    with closing(CueReader([path.parent], [guessed_camera("a", SIZE)], cue_settings(), plates=[path])) as reader:
        return reader.notes


def _labels(path: Path) -> object:
    return load_keypoints(path.parent, image_size=SIZE)


@cache
def _clicked() -> KeypointTrack:
    return no_clicks([mark.name for mark in load_subject("human34").landmarks], FRAMES, SIZE, 30.0)


READERS = {
    "keypoints": Reader("json", load_keypoints, 0.12),
    "keypoint folder": Reader("json", lambda path: load_keypoints(path.parent), 0.086, folder=True),
    "deeplabcut": Reader("text", load_keypoints, 0.03),
    "keypoint h5": Reader("json", load_keypoints, 0.03),
    "coco": Reader("json", load_keypoints, 0.03),
    "rtmlib": Reader("json", load_keypoints, 0.02),
    "ultralytics": Reader("json", partial(load_keypoints, image_size=SIZE), 0.03),
    "ultralytics labels": Reader("text", _labels, 0.02, folder=True),
    "keypoint arrays": Reader("npz", load_keypoints, 0.02),
    "keypoint array": Reader("npy", load_keypoints, 0.02),
    "clicks": Reader("json", lambda path: load_clicks(path, _clicked()), 0.05),
    "page": Reader("json", lambda path: clicks_from_page(read_json(path), _clicked()), 0.05),
    "cameras": Reader("json", load_cameras, 0.14),
    "camera text": Reader("text", load_cameras, 0.06),
    "bvh": Reader("text", _bvh, 0.06),
    "motion csv": Reader("text", _motion, 0.02),
    "motion npz": Reader("npz", _motion, 0.02),
    "settings": Reader("text", lambda path: read_settings("css", path), 0.06),
    "reference": Reader("npz", Reference.load, 0.04),
    "trc": Reader("text", Reference.load, 0.05),
    "angles": Reader("text", Reference.load, 0.02),
    "c3d": Reader("binary", Reference.load, 0.03),
    "points trc": Reader("text", load_points, 0.02),
    "points c3d": Reader("binary", partial(load_points, up="z"), 0.02),
    "points npz": Reader("npz", load_points, 0.02),
    "points npy": Reader("npy", partial(load_points, fps=100.0, unit="m", up="z"), 0.02),
    "points csv": Reader("text", load_points, 0.02),
    "urdf": Reader("text", _body, 0.008),
    "landmark file": Reader("text", _landmark_file, 0.004),
    "limb file": Reader("text", _limb_file, 0.004),
    "potentials": Reader("json", use_potentials, 0.01),
    "templates": Reader("npz", use_templates, 0.01),
    "mesh": Reader("text", lambda path: _body(path.with_name("arm.urdf")), 0.003),
    "run": Reader("run", _run, 0.008),
    "state": Reader("run", _state, 0.004),
    "film": Reader("binary", _clip, 0.004),
    "pictures": Reader("binary", _folder, 0.005, folder=True),
    "background": Reader("binary", _plate, 0.004),
}
"""By name; "state" reads runs that were not finished."""
CORPUS_OF = {"state": "unfinished run", "points trc": "trc", "points c3d": "c3d"}
