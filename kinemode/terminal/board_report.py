"""What `calibrate` prints."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from kinemode.terminal.report import console, print_lines, print_notes, table

if TYPE_CHECKING:
    from estimator.data.boards.calibrate import BoardCalibration

_MOST_VIEWS = 10  # of a camera that are listed


def print_calibration(calibration: BoardCalibration, out: Path, picture: Path | None) -> None:
    """Errors of the cameras and of their views, the worst first, where the world is, and what was written."""
    several = len(calibration.cameras) > 1
    columns = ["camera", "pictures", "with the board", "focal length [px]", "error [px]"]
    made = table("cameras", *columns, *(["error across cameras [px]"] if several else []))
    for name, camera in calibration.cameras.items():
        views = calibration.of(name)
        across = [f"{calibration.placed_errors[name]:.3f}"] if several else []
        focal = f"{camera.K[0, 0]:.1f}, {camera.K[1, 1]:.1f}"
        error = f"{calibration.lens_errors[name]:.3f}"
        made.add_row(name, str(calibration.looked_at[name]), str(len(views)), focal, error, *across)
    each = table("views, the worst first", "camera", "picture", "corners", "error [px]")
    left_out = 0
    for name in calibration.cameras:
        views = calibration.of(name)
        for view in views[:_MOST_VIEWS]:
            each.add_row(name, view.view.label, str(int(view.view.seen.sum())), f"{view.error:.3f}")
        left_out += len(views[_MOST_VIEWS:])
    console().print(made)
    console().print(each)
    lines = [f"{left_out} views with smaller errors are not listed"] if left_out else []
    if calibration.origin is None:
        lines.append("no placement: the camera stands level at the origin; --origin FRAME takes the board there")
    else:
        lines.append(
            f"world: the board in picture {calibration.origin}, x along its columns, z out of its face: up where it"
            " lies on the floor"
        )
    lines.append(f"cameras written to {out}")
    lines += [] if picture is None else [f"picture written to {picture}"]
    print_lines(lines)
    print_notes(calibration.notes)
