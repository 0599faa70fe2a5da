"""Ground reaction forces, joint moments and powers over time with their uncertainty, and as files: csv with bands,
external loads and inverse dynamics as OpenSim reads them."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from estimator.data.formats.opensim import R_OPENSIM_WORLD, write_storage
from estimator.dynamics.contact_forces import GRAVITY
from humanoid.support.errors import InputError
from humanoid.support.files import replacing
from humanoid.support.summary import Facts, Summarised

_AXES = ("x", "y", "z")
_LEVELS = (0.5, 0.9)
_OF_FEET = ("force", "force_in_facing", "total", "total_in_facing")


class BodyMass(NamedTuple):
    """kilograms and their standard deviation; source: where they come from."""

    kilograms: float
    std: float
    source: str


@dataclass(frozen=True, eq=False, repr=False)
class Forces(Summarised):
    """Forces of a run over T frames, world z up, NaN where there are no accelerations: in frames without a pose, and
    where fewer than eight are in a row.

    time (T,) [s]. mass: see `BodyMass`. feet: "left" and "right", none for a body with a fixed base. force (T, F, 3)
    [N]: of the ground on each foot. pressure (T, F, 3) [m]: centres of pressure, NaN where a foot carries less than 2 %
    of the weight. free_moment (T, F) [N m]: about the vertical there. seat (T, 3) [N]: what something else carries at
    the hips, such as a chair. hand_names (H), hands (T, H, 3) [N]: of the ground on wrists that stand on it. names,
    units (J), moment (T, J) [N m; N of joints that slide]: of the joints by their degrees of freedom, positive where
    they drive these up. power (T, J) [W]. residual (T, 6) [N, N m]: what the balance of the root lacks, in the world,
    moments about the root. facing (T, 2): level unit vector of the way the pelvis faces, over about half a second, NaN
    of a body without feet. samples: the same computed from what might be instead, (S, T, ...) each. remark: reasons for
    doubt; may be empty.
    """

    time: np.ndarray
    mass: BodyMass
    feet: tuple[str, ...]
    force: np.ndarray
    pressure: np.ndarray
    free_moment: np.ndarray
    seat: np.ndarray
    hand_names: tuple[str, ...]
    hands: np.ndarray
    names: tuple[str, ...]
    units: tuple[str, ...]
    moment: np.ndarray
    power: np.ndarray
    residual: np.ndarray
    facing: np.ndarray
    samples: ForceSamples
    remark: str = ""

    @property
    def weight(self) -> float:
        """[N]"""
        return GRAVITY * self.mass.kilograms

    @property
    def total(self) -> np.ndarray:
        """Sum (T, 3) [N] of the forces on the feet."""
        return np.asarray(self.force.sum(axis=1))

    @property
    def total_in_facing(self) -> np.ndarray:
        """The same (T, 3) [N] along the way the body faces, to its left, and upwards."""
        return np.asarray(self.force_in_facing.sum(axis=1))

    @property
    def force_in_facing(self) -> np.ndarray:
        """Forces (T, F, 3) [N] on the feet along the way the body faces, to its left, and upwards."""
        return self.in_facing(self.force)

    def in_facing(self, force: np.ndarray) -> np.ndarray:
        """Forces (..., T, F, 3) [N] of the world along the way the body faces, to its left, and upwards."""
        x, y = self.facing.T[:, :, None]
        turned = force[..., 0] * x + force[..., 1] * y, force[..., 1] * x - force[..., 0] * y, force[..., 2]
        return np.stack(turned, axis=-1)

    def std(self, quantity: str) -> np.ndarray:
        """Standard deviation of "force", "force_in_facing", "pressure", "free_moment", "seat", "hands", "total",
        "total_in_facing", "moment" or "power", shaped as it; raises InputError for another name."""
        known = (*ForceSamples._fields, *_OF_FEET[1:])
        if quantity not in known:
            raise InputError("quantity", f"there is no {quantity!r}", remedy=f"one of {', '.join(known)}")
        if quantity in _OF_FEET:  # what the balance lacks may be theirs
            drawn = self._of_feet(quantity, self.samples.force)
            lacking = self._of_feet(quantity, self.residual[:, None, :3])
        else:
            drawn, lacking = getattr(self.samples, quantity), None
        enough = np.isfinite(drawn).sum(axis=0) > 1
        off = np.where(enough, drawn, 0.0)
        mean = np.nanmean(off, axis=0)
        spread = np.sqrt(np.nanmean(np.square(off - mean), axis=0) * len(drawn) / max(len(drawn) - 1, 1))
        if lacking is not None:
            spread = np.hypot(spread, np.abs(lacking))
        if quantity != "pressure":
            spread = np.hypot(spread, np.abs(getattr(self, quantity)) * self.mass.std / self.mass.kilograms)
        return np.where(enough, spread, np.nan)

    def _of_feet(self, quantity: str, force: np.ndarray) -> np.ndarray:
        """One of `_OF_FEET` of forces (..., T, F, 3) [N] on feet."""
        turned = self.in_facing(force) if quantity.endswith("_in_facing") else force
        return np.asarray(turned.sum(axis=-2) if quantity.startswith("total") else turned)

    def interval(self, quantity: str, level: float = 0.9) -> np.ndarray:
        """Ends (2, T, ...) of the interval that holds a quantity with probability `level`: `half_width` on either side.

        Raises InputError for another name, or a level that is not between 0 and 1.
        """
        half, value = self.half_width(quantity, level), getattr(self, quantity)
        return np.stack([value - half, value + half])

    def half_width(self, quantity: str, level: float = 0.9) -> np.ndarray:
        """Half the width (T, ...) of the interval that holds a quantity with probability `level`, by its standard
        deviation, NaN where the quantity is; raises as `interval` does."""
        if not 0.0 < level < 1.0:
            raise InputError("level", f"must be between 0 and 1, got {level:g}", remedy="0.9 for 90 %")
        half = float(ndtri(0.5 + 0.5 * level)) * self.std(quantity)
        return np.where(np.isnan(getattr(self, quantity)), np.nan, half)

    def in_percent(self, force: np.ndarray) -> np.ndarray:
        """A force [N] in percent of the body's weight."""
        return 100.0 * force / self.weight

    def write(self, path: str | Path) -> Path:
        """Write a file by its ending, and return its path: .csv has everything, with half-widths of the 50 and 90 %
        intervals; .mot the external loads for OpenSim, force, centre of pressure and free moment of each foot; .sto the
        joint moments, as OpenSim's inverse dynamics writes them.

        Raises
        ------
        InputError: another ending, external loads of a body without feet, or a file that is not writable.
        """
        path = Path(path)
        with replacing(path) as temporary:
            WRITERS[check_ending(path)](self, temporary, path.name)
        return path

    def _facts(self) -> Facts:
        known = np.isfinite(self.residual).all(axis=1)
        facts = [("frames", f"{len(self.time)}"), ("mass", f"{self.mass.kilograms:.1f} +- {self.mass.std:.1f} kg")]
        for k, side in enumerate(self.feet):
            peak = self.in_percent(np.nanmax(self.force[:, k, 2])) if known.any() else np.nan
            facts.append((f"{side} foot at most", f"{peak:.0f} % of the weight"))
        return [*facts, ("but", self.remark)] if self.remark else facts


def check_ending(path: str | Path) -> str:
    """The ending of a file of forces in lower case; raises InputError for another one."""
    ending = Path(path).suffix.lower()
    if ending not in WRITERS:
        raise InputError(path, "is not a file of forces", remedy=f"let it end in {', '.join(WRITERS)}")
    return ending


class ForceSamples(NamedTuple):
    """S samples of quantities of `Forces`, (S, T, ...) each."""

    force: np.ndarray
    pressure: np.ndarray
    free_moment: np.ndarray
    seat: np.ndarray
    hands: np.ndarray
    moment: np.ndarray
    power: np.ndarray


def _csv(forces: Forces, path: Path, name: str) -> None:
    columns = list(_columns(forces))
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["time [s]", *(column for column, _ in columns)])
        values = np.column_stack([forces.time, *(value for _, value in columns)])
        rows.writerows([["" if np.isnan(v) else f"{v:.6g}" for v in row] for row in values])


def _columns(forces: Forces) -> Iterator[tuple[str, np.ndarray]]:
    """Columns (T,) of the csv by their heads."""
    halves = {q: {level: forces.half_width(q, level) for level in _LEVELS} for q in _QUANTITIES}

    def banded(head: str, unit: str, quantity: str, *place: int) -> Iterator[tuple[str, np.ndarray]]:
        where: tuple[slice | int, ...] = (slice(None), *place)
        yield f"{head} [{unit}]", getattr(forces, quantity)[where]
        for level in _LEVELS:
            yield f"{head} +- {100 * level:.0f} % [{unit}]", halves[quantity][level][where]

    for k, foot in enumerate(forces.feet):
        for i, axis in enumerate(_AXES):
            yield from banded(f"{foot} force {axis}", "N", "force", k, i)
            yield f"{foot} force {axis} [% of weight]", forces.in_percent(forces.force[:, k, i])
        for i, way in enumerate(("forwards", "to the left")):
            yield from banded(f"{foot} force {way}", "N", "force_in_facing", k, i)
        for i, axis in enumerate(_AXES):
            yield from banded(f"{foot} pressure {axis}", "m", "pressure", k, i)
        yield from banded(f"{foot} free moment", "N m", "free_moment", k)
    if forces.feet:
        for i, axis in enumerate(_AXES):
            yield from banded(f"seat force {axis}", "N", "seat", i)
        for h, hand in enumerate(forces.hand_names):
            for i, axis in enumerate(_AXES):
                yield from banded(f"{hand} force {axis}", "N", "hands", h, i)
    for j, joint in enumerate(forces.names):
        yield from banded(f"{joint} moment", forces.units[j], "moment", j)
        yield from banded(f"{joint} power", "W", "power", j)
    if forces.feet:
        for i, axis in enumerate(_AXES):
            yield f"residual force {axis} [N]", forces.residual[:, i]
            yield f"residual moment {axis} [N m]", forces.residual[:, 3 + i]


_QUANTITIES = ("force", "force_in_facing", "pressure", "free_moment", "seat", "hands", "moment", "power")


def _external_loads(forces: Forces, path: Path, name: str) -> None:
    """Where a foot carries nothing its centre of pressure is 0, as OpenSim's own files have it."""
    if not forces.feet:
        raise InputError(name, "the body stands on no feet: there are no external loads", remedy="write .sto or .csv")
    heads, columns = [], []
    known = np.isfinite(forces.force).all(axis=(1, 2))
    for k, foot in enumerate(forces.feet):
        level = np.zeros((len(known), 2))
        turning = np.column_stack([level[:, 0], forces.free_moment[:, k], level[:, 1]])
        pressure = np.nan_to_num(forces.pressure[:, k] @ R_OPENSIM_WORLD.T)
        heads += [f"ground_{kind}_{foot[0]}_{letter}{axis}" for kind, letter in _LOADS for axis in _AXES]
        columns += [forces.force[:, k] @ R_OPENSIM_WORLD.T, np.where(known[:, None], pressure, np.nan), turning]
    _write_known(path, name, heads, np.hstack(columns), forces.time)


_LOADS = (("force", "v"), ("force", "p"), ("torque", ""))


def _inverse_dynamics(forces: Forces, path: Path, name: str) -> None:
    kinds = [
        f"{joint}_{'force' if unit == 'N' else 'moment'}"
        for joint, unit in zip(forces.names, forces.units, strict=True)
    ]
    _write_known(path, name, kinds, forces.moment, forces.time)


def _write_known(path: Path, title: str, names: list[str], values: np.ndarray, time: np.ndarray) -> None:
    """Write columns (T, N) as an OpenSim storage, without the frames that have no values."""
    known = np.isfinite(values).all(axis=1)
    write_storage(path, names, values[known], time[known], title=title)


WRITERS: Mapping[str, Callable[[Forces, Path, str], None]] = {
    ".csv": _csv,
    ".mot": _external_loads,
    ".sto": _inverse_dynamics,
}
"""By the ending of a file."""
