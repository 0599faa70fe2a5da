"""The joints of a run as columns with units in their names, standard deviations beside values."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.runs.coordinates import joint_entries, q_columns
from estimator.runs.joint_angle import ONE_NUMBER, JointAngle, joint_angle
from humanoid.support.extras import optional

if TYPE_CHECKING:
    from estimator.runs.run_reader import Run


def joint_columns(run: Run, degrees: bool) -> dict[str, np.ndarray]:
    """Columns (T,) by name, joint by joint: `root_x_m`, `root_qw`, `left_knee_flexion_rad`,
    `left_knee_flexion_std_rad`.

    degrees: `left_knee_flexion_deg` and `left_knee_flexion_std_deg` instead. Joints that slide are `_m`. Of a joint of
    several degrees of freedom, as a free root, there are the entries of q, without standard deviations: its tangent
    space has other axes (`Run.std`).
    """
    names, columns = q_columns(run.body), dict[str, np.ndarray]()
    for entry in joint_entries(run.body):
        if entry.kind in ONE_NUMBER:
            angle = joint_angle(run, entry)
            columns |= _of(angle.degrees if degrees else angle)
        else:
            columns |= {names[k]: run.q[:, k] for k in range(entry.start, entry.start + entry.count)}
    return columns


def std_columns(run: Run) -> dict[str, np.ndarray]:
    """The standard deviations alone (T,) [rad or m], by the names of `joint_columns`."""
    entries = (entry for entry in joint_entries(run.body) if entry.kind in ONE_NUMBER)
    return dict(list(_of(joint_angle(run, entry)).items())[1] for entry in entries)


def _of(angle: JointAngle) -> dict[str, np.ndarray]:
    """The value, NaN for an unobserved joint, then its standard deviation."""
    value = angle.value if angle.seen else np.full_like(angle.value, np.nan)
    return {f"{angle.name}_{angle.unit}": value, f"{angle.name}_std_{angle.unit}": angle.std}


def data_frame(run: Run, degrees: bool) -> Any:
    """A pandas.DataFrame: `time_s`, `status`, and `joint_columns`; raises InputError where pandas is missing."""
    pandas = optional("pandas", "pandas", "tables of runs")
    return pandas.DataFrame({"time_s": run.time, "status": run.status, **joint_columns(run, degrees)})
