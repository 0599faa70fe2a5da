"""An export format of another package: the path length of the first landmark. Registered by being imported."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from estimator.runs.export import Exporter, register
from estimator.runs.run_reader import Run


def write(run: Run, path: Path, name: str) -> None:
    steps = np.linalg.norm(np.diff(run.landmarks[:, 0], axis=0), axis=1)
    path.write_text(f"{name}: {run.frame_count} frames, {steps.sum():.3f} m\n", encoding="utf-8")


register(Exporter("path", write))
