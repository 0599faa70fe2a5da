"""Processor time to import kinemode, to print help, and to report a missing file.

Each is a process of its own, measured from outside (user and system time, all threads). The least of several goes into
the table: what is above it is other work of the machine.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from kinemode.terminal import report

TARGET = 0.5  # s of processor time
FILE, RUN = "file.json", "absent.run"
LINES: dict[str, tuple[str, ...]] = {
    "import kinemode": ("-c", "import kinemode"),
    "--help": ("--help",),
    "track, no such clip": ("track", "absent.mp4", "--keypoints", "absent.json", "--out", "a.run"),
    "track, no such keypoints": ("track", "--keypoints", "absent.json", "--out", "a.run"),
    "track, no such cameras": ("track", "--keypoints", FILE, "--cameras", "absent.json", "--out", "a.run"),
    "track, no such settings": ("track", "--keypoints", FILE, "--settings", "absent.toml", "--out", "a.run"),
    "track, no such subject": ("track", "--keypoints", FILE, "--subject", "absent.urdf", "--out", "a.run"),
    "fit, no such clip": ("fit", "absent.mp4", "--keypoints", FILE, "--out", "a.urdf"),
    "calibrate, no such pictures": ("calibrate", "absent.mp4", "--square", "0.03", "--out", "a.json"),
    "calibrate, no such lenses": ("calibrate", "--from-person", "--keypoints", FILE, "--lenses", "no", "--out", "a"),
    "compare, no such clip": ("compare", "absent.mp4", "--keypoints", FILE, "--trackers", "css", "--out", "all"),
    "detect, no such clip": ("detect", "absent.mp4", "--out", "a.json"),
    "live, no such clip": ("live", "absent.mp4", "--keypoints", FILE),
    "annotate, no such clip": ("annotate", "absent.mp4", "--no-browser"),
    "render, no such motion": ("render", "--motion", "absent.bvh", "--out", "clip"),
    "subjects, no such URDF": ("subjects", "--landmarks", "absent.urdf"),
    "view, no such run": ("view", RUN),
    "overlay, no such run": ("overlay", RUN, "--out", "a.mp4"),
    "plot, no such run": ("plot", RUN, "--out", "a.png"),
    "report, no such run": ("report", RUN, "--out", "a.html"),
    "explain, no such run": ("explain", RUN, "--frame", "0"),
    "export, no such run": ("export", RUN, "a.csv"),
    "gait, no such run": ("gait", RUN),
    "evaluate, no such run": ("evaluate", RUN, "--reference", FILE),
}
"""By what is measured: arguments of the command line, or of Python."""


def main(*, times: int = 3) -> None:
    """Print the table.

    Parameters
    ----------
    times
        How often each is run.
    """
    made = report.table("processor time [s]", "what", "default", "one BLAS thread")
    slow = []
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / FILE).write_text("{}")
        for name, line in LINES.items():
            plain, single = (min(seconds(line, folder, threads) for _ in range(times)) for threads in (None, "1"))
            made.add_row(name, f"{plain:.2f}", f"{single:.2f}")
            slow += [name] if plain > TARGET else []
    report.console().print(made)
    print(f"target: under {TARGET:g} s each" + (f"; missed by: {', '.join(slow)}" if slow else ""))


def seconds(line: tuple[str, ...], folder: str, blas_threads: str | None) -> float:
    """Processor time of one run [s]; blas_threads: how many OpenBLAS may start, None for its default."""
    words = line if line[0] == "-c" else ("-m", "kinemode", *line)
    more = {} if blas_threads is None else {"OPENBLAS_NUM_THREADS": blas_threads}
    before = _spent()
    subprocess.run([sys.executable, *words], cwd=folder, env=os.environ | more, capture_output=True, check=False)
    return _spent() - before


def _spent() -> float:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return children.ru_utime + children.ru_stime
