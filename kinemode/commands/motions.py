"""The command that makes a motion another body's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from kinemode.flags import flags_of
from kinemode.request import RetargetRequest


@flags_of(RetargetRequest, needed=("out",), arguments=("source",), source=None, subject="example-robot-data:g1")
def retarget(*, metrics: Path | None = None, **given: Any) -> None:
    """Make a person's motion a robot's, or any other body's: within its limits, feet on the ground.

    Without a source it begins a correspondence: --match names the subject, --out the TOML file.

    Examples:

    kinemode retarget walk.run --subject example-robot-data:g1 --out g1.run

    kinemode retarget walk.bvh --subject robot.urdf --match match.toml --out robot.run --metrics robot.csv

    kinemode retarget --match robot.urdf --out match.toml

    Parameters
    ----------
    metrics
        Also write the figures that are printed to this csv file.
    """
    import kinemode as km

    if given.get("source") is None:
        if given.get("match") is None:
            raise km.InputError(
                "retarget", "nothing to retarget", remedy="name a run or a file; --match SUBJECT begins"
            )
        km.match_start(given["match"], out=given["out"])
        print(given["out"])
        return
    run = km.retarget(**given, progress=km.reported)
    from kinemode.motion_figures import motion_figures, write_figures
    from kinemode.terminal import report

    figures = motion_figures(run)
    report.print_lines([f"{name}: {value}" for name, value in figures.rows()])
    if metrics is not None:
        print(write_figures(figures, metrics))
    print(run.file)
