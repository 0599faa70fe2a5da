"""Runs as files for other programs: npz, csv, trc, mot, osim, mot in the coordinates of gait models, c3d, bvh, and
motions for trainers.

npz has all hypotheses; of the others each has the best path alone.

A run that is not finished is exported as far as it goes.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.formats.bvh import write_bvh
from estimator.data.formats.c3d import Channels, write_c3d
from estimator.data.formats.opensim import ROOT_NOTE, write_mot, write_trc
from estimator.data.formats.osim import write_osim
from estimator.runs.bvh_skeleton import bvh_motion
from estimator.runs.contact import contact_of_run
from estimator.runs.coordinates import follower_columns, joint_entries, opensim_coordinates, q_columns
from estimator.runs.filtering import EvenMotion, even_motion
from estimator.runs.gait_coordinates import GAIT_MODELS, gait_coordinates
from estimator.runs.joint_angle import joint_columns, std_columns
from estimator.runs.opensim_model import opensim_model
from estimator.runs.run_arrays import EXTRA
from estimator.runs.run_reader import Run, landmarks_along
from estimator.runs.trainer_motion import write_motion_csv, write_motion_npz
from estimator.runs.unobserved import unobserved_note
from humanoid.subject.joint_names import ROOT_TURNS, joint_names
from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from humanoid.support.plugins import Registry

Writer = Callable[[Run, Path, str], None]
"""Writes a run into a file: the run, the file to write, the name it will have."""


@dataclass(frozen=True)
class Exporter:
    """A format that runs are written in; register it with `register`.

    name: for `--format` and a file's ending. write: see `Writer`. one_rate: frames at uneven times are written at even
    ones (see `even_motion`). marks: the file shows which frames were not observed, by their status, as missing points
    or by a line; or it has no frames.
    """

    name: str
    write: Writer
    one_rate: bool = False
    marks: bool = True


def export(
    run: Run,
    path: str | Path,
    format: str | None = None,
    *,
    degrees: bool = False,
) -> Path:
    """Write a run in a format of `EXPORTERS`, by default that of the file's ending. The file is written whole or not at
    all.

    degrees: of csv, joints in degrees with their standard deviations beside them.

    Raises
    ------
    InputError: an unknown format, degrees for a format other than csv, or a file that is not writable.
    """
    path = Path(path)
    chosen = chosen_format(path, format)
    if chosen not in EXPORTERS:
        raise InputError(path, f"no export format {chosen!r}", remedy=f"one of {', '.join(EXPORTERS)}")
    if degrees and chosen != "csv":
        raise InputError("degrees", f"{chosen} has its own units", remedy="leave it out, or export csv")
    with replacing(path) as temporary:
        (_csv_degrees if degrees else EXPORTERS[chosen].write)(run, temporary, path.name)
    return path


def chosen_format(path: Path, format: str | None) -> str:
    """The format that is named, or that the file's ending names."""
    return (format or path.suffix.lstrip(".")).lower()


def export_arrays(run: Run) -> dict[str, np.ndarray]:
    """The arrays of the npz.

    time (T,) [s]; q (T, nq) of the best hypothesis, Pinocchio order; landmarks (T, L, 3) [m], world; mode_q (T, K, nq),
    mode_weight (T, K), mode_landmarks (T, K, L, 3), NaN-padded; covariance (T, nv, nv); std (T, nv), calibrated, of all
    hypotheses together; energy (T,); status (T,) text;
    q_names, v_names, joint_names, landmark_names text; unseen_joint_names, unseen_landmark_names text, of what nothing
    shows;
    extra_NAME (T, ...), what the tracker reported beside its hypotheses, see `Run.extra`. Of a body with feet also
    contact_names text; contact (T, P), probabilities that its
    heels and toes stand, and contact_height (T, P) [m] above the floor, NaN without one (`estimator.runs.contact`).
    """
    return {
        "time": run.time,
        "q": run.q,
        "q_names": np.array(run.body.q_names, dtype=np.str_),
        "v_names": np.array(run.body.v_names, dtype=np.str_),
        "joint_names": np.array(joint_names(run.body.model), dtype=np.str_),
        "unseen_joint_names": np.array(run.unseen_joints, dtype=np.str_),
        "landmark_names": np.array(run.body.landmark_names, dtype=np.str_),
        "unseen_landmark_names": np.array(run.unseen_landmarks, dtype=np.str_),
        "landmarks": run.landmarks,
        "mode_q": run.mode_q,
        "mode_weight": run.mode_weight,
        "mode_landmarks": run.mode_landmarks,
        "covariance": run.covariance,
        "std": run.std,
        "energy": run.energy,
        "status": run.status,
        **{EXTRA + name: array for name, array in run.extra.items()},
        **_contact_arrays(run),
    }


def _contact_arrays(run: Run) -> dict[str, np.ndarray]:
    contact = contact_of_run(run)
    if contact is None:
        return {}
    names = np.array(contact.names, dtype=np.str_)
    return {"contact_names": names, "contact": contact.standing, "contact_height": contact.heights}


def _npz(run: Run, path: Path, name: str) -> None:
    arrays: dict[str, Any] = dict(export_arrays(run))
    with path.open("wb") as file:  # given a path, numpy would append .npz to it
        np.savez_compressed(file, **arrays)


def _csv(run: Run, path: Path, name: str) -> None:
    """time_s, the entries of q with their units, joints that follow others, landmarks `nose_x_m` ..., weight, energy,
    status; then, so that these stay in their places, the joints' standard deviations. A joint or landmark that nothing
    shows is empty."""
    followers, following = follower_columns(run.body, run.q)
    measured = np.where(np.isin(run.body.q_names, run.unseen_joints), np.nan, run.q)
    joints = dict(zip((*q_columns(run.body), *followers), (*measured.T, *following.T), strict=True))
    _write_csv(run, path, joints, std_columns(run.joints.values()))


def _csv_degrees(run: Run, path: Path, name: str) -> None:
    """The same with joints in degrees, each standard deviation beside its joint."""
    _write_csv(run, path, joint_columns(run.body, run.q, run.joints, degrees=True), {})


def _write_csv(run: Run, path: Path, joints: Mapping[str, np.ndarray], last: Mapping[str, np.ndarray]) -> None:
    points = [f"{landmark}_{axis}_m" for landmark in run.body.landmark_names for axis in "xyz"]
    landmarks = _shown(run, run.landmarks).reshape(run.frame_count, len(points))
    before = np.column_stack([run.time, *joints.values(), landmarks, run.weight, run.energy])
    behind = np.array(list(last.values())).reshape(len(last), run.frame_count).T
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["time_s", *joints, *points, "weight", "energy", "status", *last])
        for row, status, more in zip(before, run.status, behind, strict=True):
            rows.writerow([*map(_cell, row), status, *map(_cell, more)])


def _cell(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.9g}"


def _trc(run: Run, path: Path, name: str) -> None:
    """Landmarks as markers; unobserved ones, and all in frames without observations, are missing."""
    seen = (run.status != "unobserved")[:, None, None]
    landmarks = np.where(seen, _shown(run, run.landmarks), np.nan)
    write_trc(path, run.body.landmark_names, landmarks, run.time, title=name)


def _shown(run: Run, landmarks: np.ndarray) -> np.ndarray:
    """Landmarks (T, L, 3) with NaN in place of unobserved ones."""
    unseen = np.isin(run.body.landmark_names, run.unseen_landmarks)
    return np.where(unseen[:, None], np.nan, landmarks)


def _mot(run: Run, path: Path, name: str) -> None:
    names, values = opensim_coordinates(run.body, run.q)
    write_mot(path, names, values, run.time, title=Path(name).stem, note=_noted(run, ROOT_NOTE))


def _noted(run: Run, note: str) -> str:
    """A line for the header of a mot file, with the unobserved stretches."""
    unseen = unobserved_note(run.unobserved, run.unseen_joints)
    return f"{note} In this motion {unseen}." if unseen else note


def _c3d(run: Run, path: Path, name: str) -> None:
    """Landmarks as points, the angles of mot as POINT:ANGLES, sliding joints as POINT:SCALARS; where nothing was seen
    they are missing. Frames at uneven times become even ones, see `even_motion`."""
    motion = _even(run)
    names, values = opensim_coordinates(run.body, motion.q)
    kinds = {entry.name: entry.kind for entry in joint_entries(run.body)}
    seen = motion.seen[:, None]
    values[:, np.isin(names, run.unseen_joints)] = np.nan
    turns = [i for i, n in enumerate(names) if n in ROOT_TURNS or kinds.get(n) in ("turn", "endless")]
    slides = [i for i, n in enumerate(names) if kinds.get(n) == "slide"]
    angles = Channels([names[i] for i in turns], np.where(seen, values[:, turns], np.nan), "deg")
    scalars = Channels([names[i] for i in slides], np.where(seen, 1e3 * values[:, slides], np.nan), "mm")
    points = run.landmarks if motion.q is run.q else landmarks_along(run.body, motion.q)
    landmarks = np.where(seen[..., None], _shown(run, points), np.nan)
    write_c3d(path, run.body.landmark_names, landmarks, motion.time, angles, scalars)


def _bvh(run: Run, path: Path, name: str) -> None:
    motion = _even(run)
    write_bvh(path, bvh_motion(run.body, motion.q, motion.time))


def _even(run: Run) -> EvenMotion:
    if not run.frame_count:
        raise InputError(run.file, "contains no frames", remedy="track with --resume first")
    return even_motion(run.body, run.q, run.time, run.status != "unobserved")


def _gait_mot(model: str, run: Run, path: Path, name: str) -> None:
    title = GAIT_MODELS[model].title
    names, values = gait_coordinates(run.body, run.q, GAIT_MODELS[model])
    note = f"Coordinates of the OpenSim model {title}; those not measured are 0."
    write_mot(path, names, values, run.time, title=Path(name).stem, note=_noted(run, note))


def _motion_npz(run: Run, path: Path, name: str) -> None:
    write_motion_npz(run, path)


def _motion_csv(run: Run, path: Path, name: str) -> None:
    write_motion_csv(run, path)


def _osim(run: Run, path: Path, name: str) -> None:
    write_osim(path, opensim_model(run.body, Path(name).stem))


EXPORTERS: Registry[Exporter] = Registry(
    "export format",
    (
        Exporter("npz", _npz),
        Exporter("csv", _csv),
        Exporter("trc", _trc),
        Exporter("mot", _mot),
        Exporter("osim", _osim),
        *(Exporter(f"{model}-mot", partial(_gait_mot, model)) for model in GAIT_MODELS),
        Exporter("c3d", _c3d, one_rate=True),
        Exporter("bvh", _bvh, one_rate=True, marks=False),
        Exporter("motion-npz", _motion_npz, one_rate=True, marks=False),
        Exporter("motion-csv", _motion_csv, one_rate=True, marks=False),
    ),
)
"""Formats by name. `viz.exporters` registers those that show the body."""
register = EXPORTERS.register
