"""The work behind `calibrate`: pictures, or a person's keypoints, in, a camera file and a picture out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from estimator.data.boards.board import Board, Shots
from estimator.data.boards.calibrate import BoardCalibration, calibrate
from estimator.data.formats.cameras import write_cameras
from estimator.data.rigs.calibrate import PersonCalibration
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Subject
from kinemode.inputs.load import calibration_by_person
from kinemode.progress import Reporter
from kinemode.request import FileOptions


def calibrated(
    sources: Mapping[str, Sequence[Path]],
    board: Mapping[str, Any],
    *,
    lens: str,
    origin: int | None,
    out: Path | None,
    picture: Path | None,
    progress: Reporter,
) -> BoardCalibration:
    """Calibrate, and write the requested files; board: arguments of `Board`."""
    shots = [Shots(name, paths) for name, paths in sources.items()]
    try:
        with progress("corners") as report:
            calibration = calibrate(shots, Board(**board), lens=lens, origin=origin, progress=report)
        if out is not None:
            write_cameras(out, calibration.cameras.values())
        if picture is not None:
            from viz.pictures.board_picture import write_board_picture

            by_name = {s.name: s for s in shots}
            write_board_picture(calibration, lambda view: by_name[view.camera].picture(view.frame), picture)
    finally:
        for s in shots:
            s.close()
    return calibration


def calibrated_by_person(
    subject: Subject, files: FileOptions, out: Path | None, picture: Path | None
) -> PersonCalibration:  # fmt: skip
    """Find cameras from the person in files, and write the requested files."""
    calibration = calibration_by_person(Body(subject), files)
    if out is not None:
        write_cameras(out, calibration.cameras.values())
    if picture is not None:
        from viz.pictures.rig_picture import write_rig_picture

        write_rig_picture(calibration, picture)
    return calibration
