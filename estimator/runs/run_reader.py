"""Run files, the reading side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estimator.data.formats.checked_arrays import Field, sizes_of
from estimator.data.formats.packing import unpack
from estimator.data.observation import LiftedPose, Observation, PoseEstimate
from estimator.data.standing import HIP_SPAN, with_standing
from estimator.inference.ground import Ground
from estimator.inference.origin import ORIGIN_FIELDS, families
from estimator.numerics.stretches import stretches
from estimator.runs import run_store
from estimator.runs.coordinates import JointEntry, joint_entries
from estimator.runs.filtering import Filtering, filtered
from estimator.runs.joint_angle import ONE_NUMBER, JointAngle, joint_angle, joint_columns, joint_entry, joint_value
from estimator.runs.marginals import LEVEL, Marginals, Spread, checked_level, spread_of
from estimator.runs.posterior import Posterior, PosteriorCalibration, tempered
from estimator.runs.run_arrays import (
    check_frame,
    check_observation,
    check_smoothed,
    extra_of,
    floor_in,
    frame_result,
    joined,
    smoothed_in,
    symmetric,
)
from estimator.runs.run_header import RunHeader
from estimator.runs.run_store import TemporaryFolder
from estimator.runs.unobserved import unseen_in, unseen_landmarks
from estimator.search.jumps.readings import AWAY, TOWARDS, trunk_readings
from estimator.trackers.frame_result import HARD, RESULT_FIELDS, TRACKED, FrameResult, backtrack
from estimator.tracking.smoothing import Smoothed
from estimator.vision.cues.learned import learned_arrays, without_learned
from humanoid.kinematics.body import Body
from humanoid.subject.subject import BUILT_IN, Subject, subject_from_text
from humanoid.support.errors import InputError, misplaced
from humanoid.support.extras import optional
from humanoid.support.summary import Facts, Summarised

if TYPE_CHECKING:
    import pandas


_SMOOTHED = "smoothed trajectory"
_FEW = 1000  # frames, the arrays of which are kept once they were read


class Run(Summarised):
    """A run file as of the moment it was opened, finished or still being written.

    Arrays have one row for each of the T frames in the file, and K columns, the largest number of hypotheses of any
    frame; where a frame has fewer, numbers are NaN and indices -1. They are read on first access.

    Attributes
    ----------
    file, header: the file and what the run was made from.
    frame_count, planned_count: frames in the file, and frames there will be. complete: the run was finished.
    filtering: what `butterworth` did to `q`; None in a run that was not filtered.
    """

    def __init__(self, file: Path, header: RunHeader, frame_count: int, complete: bool) -> None:
        self.file, self.header = file, header
        self.frame_count, self.complete = frame_count, complete
        self.planned_count = len(header.times)
        self.filtering: Filtering | None = None
        self._folder = TemporaryFolder.of(file)  # kept as long as this run

    def __getstate__(self) -> dict[str, Any]:
        """A temporary file is pickled along: it may be gone before it is read elsewhere."""
        state = {**vars(self), "_folder": None}
        return state if self._folder is None else {**state, "_content": self.file.read_bytes()}

    def __setstate__(self, state: dict[str, Any]) -> None:
        content = state.pop("_content", None)
        vars(self).update(state)
        if content is not None:
            self._folder = TemporaryFolder()
            self.file = self._folder.path / self.file.name
            self.file.write_bytes(content)

    @staticmethod
    def open(path: str | Path) -> Run:
        """Open a run file; raises InputError for a file that is not one, is newer than this program, or is damaged."""
        path = Path(path)
        run_store.check(path)
        with run_store.reading(path) as connection:
            row = connection.execute("SELECT json FROM header").fetchone()
            (count,) = connection.execute("SELECT count(*) FROM frame").fetchone()
            (finished,) = connection.execute("SELECT count(*) FROM finished").fetchone()
        if row is None or not isinstance(row[0], str):
            raise InputError(path, "is damaged: it has no header")
        header = RunHeader.from_json(row[0], str(path))
        if count > len(header.times):
            raise InputError(path, f"is damaged: it has {count} frames of {len(header.times)}")
        return Run(path, header, int(count), finished > 0)

    @cached_property
    def subject(self) -> Subject:
        """The subject that was tracked."""
        return subject_from_text(self.header.subject_urdf, source=self.header.subject_source, base=self.header.base)

    @cached_property
    def body(self) -> Body:
        """The subject's kinematics."""
        return Body(self.subject)

    @cached_property
    def _frames(self) -> list[dict[str, np.ndarray]]:
        """The stored arrays of every frame."""
        return list(self._stored())

    def _each(self) -> Iterator[dict[str, np.ndarray]]:
        """`_frames` one after the other, without keeping those of a long run."""
        if self.frame_count <= _FEW or "_frames" in vars(self):
            return iter(self._frames)
        return self._stored()

    def _stored(self) -> Iterator[dict[str, np.ndarray]]:
        """One frame's arrays after the other's."""
        count, before = 0, None
        with run_store.reading(self.file) as connection:
            query = "SELECT data FROM frame WHERE position < ? ORDER BY position"
            for i, (data,) in enumerate(connection.execute(query, (self.frame_count,))):
                check = partial(check_frame, body=self.body, planned=self.planned_count, before=before)
                arrays = self._unpacked(data, f"frame {i}", check)
                count, before = count + 1, len(arrays["weight"])
                yield arrays
        if count != self.frame_count:
            raise InputError(self.file, f"is damaged: {self.frame_count - count} of its frames are missing")

    def streamed(self) -> Iterator[FrameResult]:
        """One frame after the other, read on access and not kept: all frames of a long run do not fit into memory."""
        return (frame_result(arrays, self.body) for arrays in self._stored())

    def paths(self, *, covariances: bool = False) -> Iterator[FrameResult]:
        """`streamed` without what takes most room: of the extra arrays there is only what cues have learned, and
        covariances are (K, 0, 0) unless they are requested."""
        for result in self.streamed():
            kept = result.covariance if covariances else np.zeros((len(result.weight), 0, 0))
            yield replace(result, covariance=kept, extra=learned_arrays(result.extra))

    def _unpacked(
        self, data: bytes, place: str, check: Callable[[dict[str, np.ndarray]], None]
    ) -> dict[str, np.ndarray]:
        """The arrays of a row, which `check` has nothing against."""
        return self._unpacked_as(lambda: unpack(data), place, check)

    def _unpacked_as(
        self,
        made: Callable[[], dict[str, np.ndarray]],
        place: str,
        check: Callable[[dict[str, np.ndarray]], None],
    ) -> dict[str, np.ndarray]:
        try:
            arrays = made()
            check(arrays)
        except InputError:  # of the subject
            raise
        except ValueError as error:
            raise InputError(self.file, f"is damaged: {error}", place=place) from None
        return arrays

    def result(self, i: int) -> FrameResult:
        """Frame `i` of the file; negative counts from the end. Raises InputError for anything but a whole number."""
        return frame_result(self._frames[self._frame_number(i)], self.body)

    def observation(self, i: int, *, standing: bool = False) -> Observation:
        """The observation of planned frame `i`, without the pictures; raises InputError where it was never stored, and
        for anything but a whole number.

        standing: also which points stand, for which the frames just before are read as well.
        """
        i, times = self._frame_number(i), self.header.times
        looks_back = standing and 0 <= i < len(times)
        first = int(np.searchsorted(times, times[i] - 2.0 * HIP_SPAN)) if looks_back else i
        with run_store.reading(self.file) as connection:
            rows = connection.execute(
                "SELECT position, data FROM observation WHERE position BETWEEN ? AND ? ORDER BY position", (first, i)
            ).fetchall()
        if not rows or rows[-1][0] != i:
            raise InputError(self.file, "contains no keypoints", place=f"frame {i}", remedy="track again")
        seen = [self._observed(data, k) for k, data in rows]
        return with_standing(seen, self.body.landmark_names)[-1] if standing else seen[-1]

    def _frame_number(self, i: Any) -> int:
        if isinstance(i, (int, np.integer)) and not isinstance(i, bool):
            return int(i)
        taken = f"its number, as run.result(0); a joint over time is run[{self._example_joint(i)!r}]"
        raise misplaced("frame", i, taken)

    def _example_joint(self, given: Any) -> str:
        """A joint's name for an example: the given one where it is one."""
        names = self.joint_names
        return given if isinstance(given, str) and given in names else next(iter(names), "JOINT")

    def _observed(self, data: bytes, i: int) -> Observation:
        a = self._keypoints_of(data, i)
        given = bool(a.get("given", False))
        jitter = tuple(a["jitter"].tolist()) if "jitter" in a else ()
        time = float(self.header.times[i])
        estimate = PoseEstimate(a["estimate_q"], a["estimate_covariance"]) if "estimate_q" in a else None
        seen = Observation(i, time, self.header.cameras, a["pixels"], a["confidence"], jitter, given)
        lifted = LiftedPose(a["lifted"], float(a["lifted_share"])) if "lifted" in a else None
        noise = tuple(a["noise"].tolist()) if "noise" in a else ()
        return replace(seen, estimate=estimate, lifted=lifted, markers=a.get("markers"), noise=noise)

    @property
    def estimates(self) -> dict[int, PoseEstimate] | None:
        """Estimates of poses by a fit of the person, by planned frame (see `Observation.estimate`); None where none are
        stored yet."""
        with run_store.reading(self.file) as connection:
            rows = connection.execute("SELECT position, data FROM observation ORDER BY position").fetchall()
        stored = {i: self._keypoints_of(data, i) for i, data in rows}
        known = {
            i: PoseEstimate(a["estimate_q"], a["estimate_covariance"]) for i, a in stored.items() if "estimate_q" in a
        }
        return known if rows else None

    def _keypoints_of(self, data: bytes, i: int) -> dict[str, np.ndarray]:
        cameras = len(self.header.cameras)
        return self._unpacked(data, f"keypoints of frame {i}", lambda a: check_observation(a, self.body, cameras))

    def __iter__(self) -> Iterator[FrameResult]:
        return (self.result(i) for i in range(self.frame_count))

    def __len__(self) -> int:
        return self.frame_count

    def _called(self) -> str:
        return self.file.name

    def _facts(self) -> Facts:
        times, count = self.header.times, self.frame_count
        seconds = float(times[count - 1] - times[0]) if count else 0.0
        facts = [
            ("frames", f"{count} of {self.planned_count} ({seconds:.2f} s{'' if self.complete else ', unfinished'})"),
            ("subject", Path(self.header.subject_source).name),
            ("cameras", " ".join(camera.name for camera in self.header.cameras)),
            ("tracker", self.header.tracker),
        ]
        return facts if self.filtering is None else [*facts, ("filter", f"{self.filtering.cutoff:g} Hz")]

    @property
    def hypothesis_count(self) -> int:
        """K, the largest number of hypotheses of any frame."""
        return self._most

    @cached_property
    def _most(self) -> int:
        return max((len(f["weight"]) for f in self._each()), default=0)

    @cached_property
    def time(self) -> np.ndarray:
        """(T,) [s]."""
        return np.array([float(f["time"]) for f in self._each()], dtype=np.float64)

    @cached_property
    def index(self) -> np.ndarray:
        """(T,) number of each instant among those observed; `header.frames_of` has the clips' own frames."""
        return np.array([int(f["index"]) for f in self._each()], dtype=np.int64)

    @cached_property
    def status(self) -> np.ndarray:
        """(T,) text, see `FrameResult.status`; "hard" where the findings contradict a frame, see `RunHeader`."""
        status = np.array([str(f["status"]) for f in self._each()], dtype=np.str_)
        against = [t for t in self.header.contradicted if t < len(status)]
        status[against] = np.where(status[against] == TRACKED, HARD, status[against])
        return status

    @cached_property
    def mode_q(self) -> np.ndarray:
        """(T, K, nq) configurations."""
        return self._padded("q")

    @cached_property
    def mode_weight(self) -> np.ndarray:
        """(T, K)."""
        return self._padded("weight")

    @cached_property
    def mode_energy(self) -> np.ndarray:
        """(T, K)."""
        return self._padded("energy")

    @cached_property
    def mode_kkt_residual(self) -> np.ndarray:
        """(T, K)."""
        return self._padded("kkt_residual")

    @cached_property
    def mode_penetration(self) -> np.ndarray:
        """(T, K) [m]."""
        return self._padded("penetration")

    @cached_property
    def mode_covariance(self) -> np.ndarray:
        """(T, K, nv, nv), single precision."""
        nv = self.body.nv
        out = np.full((len(self._frames), self.hypothesis_count, nv, nv), np.nan, dtype=np.float32)
        for t, frame in enumerate(self._frames):
            out[t, : len(frame["covariance"])] = symmetric(frame["covariance"], nv)
        return out

    @cached_property
    def mode_parent(self) -> np.ndarray:
        """(T, K) index into the frame before, -1 if none."""
        return self._padded("parent")

    @cached_property
    def mode_association(self) -> np.ndarray:
        """(T, K) text, empty where there is no hypothesis."""
        return self._padded("association")

    @cached_property
    def mode_velocity(self) -> np.ndarray:
        """(T, K, nv) [1/s], see `Mode`; NaN also in runs made before it was kept."""
        return self._padded("velocity")

    @cached_property
    def mode_family(self) -> np.ndarray:
        """(T, K) text: what each hypothesis was searched from, see `Origin`; empty where that is not known."""
        return self._stacked([families(f) for f in self._frames], ORIGIN_FIELDS["family"])

    @cached_property
    def mode_reading(self) -> np.ndarray:
        """(T, K) how every hypothesis reads the trunk that the only camera sees: leading "towards" it from the hips, or
        "away" from it, two poses that look alike, or "across" its rays, where both are one. "" where there is no
        hypothesis, with several cameras, and for a body without legs and a trunk."""
        return self._readings(self.mode_q)

    @cached_property
    def reading(self) -> np.ndarray:
        """(T,) how `q` reads the trunk, see `mode_reading`."""
        return self._readings(self.q)

    @cached_property
    def other_reading(self) -> np.ndarray:
        """(T,) calibrated probability that the trunk leads the other way than in `reading`: the sum of the weights of
        all hypotheses with the other reading; 0 where none has it."""
        smoothed, other = self.smoothed, {TOWARDS: AWAY, AWAY: TOWARDS}
        weights = self.mode_weight if smoothed is None or smoothed.weight is None else smoothed.weight
        out = np.zeros(len(self.mode_reading))
        for t, reading in enumerate(self.reading.tolist()):
            opposite = self.mode_reading[t] == other.get(reading)
            if opposite.any():
                out[t] = tempered(weights[t], PosteriorCalibration().weight_temperature)[opposite].sum()
        return out

    def _readings(self, q: np.ndarray) -> np.ndarray:
        """Readings of configurations (..., nq)."""
        readings, known = np.full(q.shape[:-1], "", dtype="U7"), np.isfinite(q).all(axis=-1)
        if len(self.header.cameras) == 1 and known.any():
            readings[known] = trunk_readings(self.body, q[known], self.header.cameras[0])
        return readings

    @cached_property
    def extra(self) -> Mapping[str, np.ndarray]:
        """The tracker's reports besides its hypotheses, by name (T, ...), see `FrameResult.extra`; none in runs made
        before it was stored.

        Where a frame has nothing under a name, or a smaller array than others, the rest is NaN (whole numbers and
        booleans then become floats) or empty text. Raises InputError where the arrays of a name cannot be stacked:
        some have more axes than others, or are text, or they would fill the memory; `result(i).extra` has them singly,
        and what image cues had learned before the frame.
        """
        frames = [without_learned(extra_of(f)) for f in self._frames]
        names = dict.fromkeys(name for of_frame in frames for name in of_frame)
        return {name: stacked([f.get(name) for f in frames], self.file, f"extra array {name}") for name in names}

    @cached_property
    def mode_landmarks(self) -> np.ndarray:
        """(T, K, L, 3) in the world [m]."""
        body, q = self.body, self.mode_q
        points = np.full((*q.shape[:2], len(body.landmark_names), 3), np.nan)
        for t, k in zip(*np.nonzero(np.isfinite(q).all(axis=2)), strict=True):
            points[t, k] = body.landmarks(body.at(q[t, k]))
        return points

    @cached_property
    def path(self) -> np.ndarray:
        """(T,) the best hypothesis of each frame: back from the last frame's best through the parents."""
        return backtrack(self.mode_parent, self.mode_weight)

    @cached_property
    def filtered_q(self) -> np.ndarray:
        """(T, nq) along the path, as the tracker left it."""
        out = np.full((self.frame_count, self.body.nq), np.nan)
        for t, (frame, k) in enumerate(zip(self._each(), self.path, strict=True)):
            if k >= 0:
                out[t] = frame["q"][k]
        return out

    @cached_property
    def q(self) -> np.ndarray:
        """(T, nq) of the best hypothesis: along the path and, once the run is complete, smoothed over all frames."""
        return self._smoothed.get("q", self.filtered_q)

    @property
    def floor(self) -> Ground | None:
        """The floor that the smoothed trajectory is above, given or found; None without one, and before the run is
        complete."""
        return floor_in(self._smoothed)

    @cached_property
    def smoothed(self) -> Smoothed | None:
        """The smoothed trajectory with its uncertainty, before calibration; None before the run is complete, and of one
        that was not smoothed."""
        if not self._smoothed:
            return None
        with run_store.reading(self.file) as connection:
            rows = connection.execute("SELECT data FROM smoothed ORDER BY rowid").fetchall()
        parts = [self._unpacked(data, _SMOOTHED, lambda a: None) for (data,) in rows]
        return smoothed_in(self._unpacked_as(lambda: joined(parts), _SMOOTHED, self._check_smoothed), self.body)

    @cached_property
    def _smoothed(self) -> Mapping[str, np.ndarray]:
        """The stored arrays of the smoothing, for a long run without the covariances; none before the run is
        complete."""
        with run_store.reading(self.file) as connection:
            row = connection.execute("SELECT data FROM smoothed ORDER BY rowid").fetchone()
        if row is None:
            return {}
        arrays = self._unpacked(row[0], _SMOOTHED, self._check_smoothed)
        return arrays if arrays["q"].shape == self.filtered_q.shape else {}

    def _check_smoothed(self, arrays: dict[str, np.ndarray]) -> None:
        check_smoothed(arrays, self.body)

    @cached_property
    def weight(self) -> np.ndarray:
        """(T,) along the path."""
        return self._along(self.mode_weight)

    @cached_property
    def energy(self) -> np.ndarray:
        """(T,) of the mode on the path, before smoothing."""
        return self._along(self.mode_energy)

    @cached_property
    def covariance(self) -> np.ndarray:
        """(T, nv, nv) of the mode on the path: what its own frame and the priors leave open."""
        nv = self.body.nv
        out = np.full((len(self._frames), nv, nv), np.nan)
        for t, (frame, k) in enumerate(zip(self._frames, self.path, strict=True)):
            if k >= 0:
                out[t] = symmetric(frame["covariance"][k : k + 1], nv)[0]
        return out

    def posterior(
        self, i: int, calibration: PosteriorCalibration | None = None, *, filtered: bool = False
    ) -> Posterior:
        """The posterior of the pose in frame `i` over all hypotheses: around the smoothed trajectory, from all frames,
        where the run has one; else, or if `filtered`, from this and the frames before it.

        calibration: by default the one that was fitted for either. Raises InputError where the frame has no hypotheses.
        """
        cameras = self.header.cameras
        size_known = self.header.subject_source not in BUILT_IN or "height" in self.header.settings
        result, smoothed = self.result(i), None if filtered else self.smoothed
        if smoothed is None or smoothed.covariance is None or not len(result.weight):
            return Posterior.of(self.body, result, calibration, cameras, size_known=size_known)
        return Posterior.of_trajectory(self.body, result, smoothed, i, calibration, cameras, size_known=size_known)

    @cached_property
    def spread(self) -> Spread:
        """The uncertainty of every degree of freedom in every frame, with the ends of the 90 % intervals."""
        return self._spread(LEVEL)

    def _spread(self, level: float) -> Spread:
        known = np.flatnonzero(np.isfinite(self.mode_weight).any(axis=1)).tolist()
        if self.header.retargeted:
            known = []

        def posterior(t: int) -> tuple[np.ndarray, Marginals]:
            own = self.posterior(t)
            return own.best, own.marginals()

        spread = spread_of(self.body, len(self), known, posterior, self.unseen_joints, level)
        return spread._replace(best=self.q) if self.header.retargeted else spread

    @property
    def std(self) -> np.ndarray:
        """(T, nv) calibrated standard deviation of every degree of freedom [m, rad], over all hypotheses."""
        return self.spread.std

    def interval(self, level: float) -> np.ndarray:
        """(T, 2, nq) ends of the calibrated central interval of this probability for every joint that one number places
        [rad, m], within its limits, over all hypotheses; NaN for other joints and frames without any.

        Raises InputError for a level outside 0 to 1, or one that is not a number: one joint's interval is `run[joint]`.
        """
        level = checked_level(level, self._example_joint(level))
        body, spread = self.body, self.spread if level == LEVEL else self._spread(level)
        single = [j for j in range(1, body.model.njoints) if body.model.nqs[j] == body.model.nvs[j] == 1]
        in_q, in_v = (np.array(list(indices))[single] for indices in (body.model.idx_qs, body.model.idx_vs))
        out = np.full((len(self._frames), 2, body.nq), np.nan)
        out[:, :, in_q] = spread.best[:, None, in_q] + spread.ends[:, :, in_v]
        return out

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints that have an angle, or a length: what `run[name]` and `angle` take."""
        return tuple(entry.name for entry in joint_entries(self.body) if entry.kind in ONE_NUMBER)

    @cached_property
    def unseen_joints(self) -> tuple[str, ...]:
        """The joints that are unobserved in the whole run, see `estimator.runs.unobserved.unseen_joints`: their angles
        are the prior's, and their intervals cover nearly all of their limits."""
        if self.header.cues or self.header.retargeted:  # the pose is from pictures, or from another motion
            return ()
        return unseen_in(self.body, self.confidence, self.markers)

    @property
    def unobserved(self) -> tuple[tuple[float, float], ...]:
        """First and last time [s] of every stretch of frames with a pose in which nothing was seen."""
        there = (self.status == "unobserved") & np.isfinite(self.q).all(axis=1)
        return tuple((float(self.time[first]), float(self.time[after - 1])) for first, after in stretches(there))

    @cached_property
    def unseen_landmarks(self) -> tuple[str, ...]:
        """The landmarks that such a joint moves: where they are is the prior's."""
        unseen = unseen_landmarks(self.body, self.unseen_joints)
        return tuple(name for name, of_prior in zip(self.body.landmark_names, unseen, strict=True) if of_prior)

    def __getitem__(self, joint: str) -> JointAngle:
        """A joint by its name: its value, standard deviation, 90 % interval and hypotheses over time.

        Raises InputError for an unknown name, with the nearest, or a joint of several degrees of freedom.
        """
        return self._joint(joint_entry(self.body, joint))

    def _joint(self, entry: JointEntry) -> JointAngle:
        known = self.body, self.time, self.q, self.mode_q, self.mode_weight
        return joint_angle(entry, *known, self.spread, self.unseen_joints)

    @property
    def joints(self) -> dict[str, JointAngle]:
        """Every joint that one number places, by its name, in the order of the body's joints."""
        entries = (entry for entry in joint_entries(self.body) if entry.kind in ONE_NUMBER)
        return {entry.name: self._joint(entry) for entry in entries}

    def angle(self, joint: str, degrees: bool = False) -> np.ndarray:
        """(T,) a joint of the best hypothesis [rad, or degrees; m where it slides], NaN in frames without a pose.

        Raises InputError as `run[joint]` does, and for degrees of a joint that slides.
        """
        entry = joint_entry(self.body, joint)
        if degrees and entry.kind == "slide":
            raise InputError("degrees", f"{joint!r} slides: it has metres", remedy="leave degrees out")
        value = joint_value(entry, self.q)
        return np.rad2deg(value) if degrees else value

    def to_dataframe(self, degrees: bool = False) -> pandas.DataFrame:
        """The best hypothesis as a table, a row a frame: `time_s`, `status`, root and joints with units in their names,
        standard deviations beside values (`left_knee_flexion_rad`, `left_knee_flexion_std_rad`).

        degrees: angles in degrees (`left_knee_flexion_deg`). Raises InputError where pandas is not installed.
        """
        pandas = optional("pandas", "pandas", "tables of runs")
        columns = joint_columns(self.body, self.q, self.joints, degrees)
        return pandas.DataFrame({"time_s": self.time, "status": self.status, **columns})

    def butterworth(self, cutoff: float) -> Run:
        """The same run with `q` low-pass filtered at a cut-off [Hz], without lag.

        Butterworth, fourth order (twice the second, forwards and backwards), see `estimator.runs.filtering` for
        rotations, gaps and limits, which hold afterwards. `filtering` of the new run describes what was done. Landmarks
        and everything else computed from `q` follow; hypotheses, standard deviations and intervals do not change.

        Raises InputError: a cut-off that is not above zero, or not below half the frame rate.
        """
        done = filtered(self.body, self.q, self.time, cutoff)
        known = {name: value for name, value in vars(self).items() if name not in ("q", "landmarks")}
        run = Run(self.file, self.header, self.frame_count, self.complete)
        vars(run).update(known, q=done.q, filtering=done)
        return run

    @cached_property
    def landmarks(self) -> np.ndarray:
        """(T, L, 3) of `q`, in the world [m]."""
        return landmarks_along(self.body, self.q)

    @cached_property
    def _keypoints(self) -> tuple[np.ndarray, np.ndarray]:
        with run_store.reading(self.file) as connection:
            rows = connection.execute("SELECT data FROM observation ORDER BY position").fetchall()
        frames = [self._keypoints_of(data, i) for i, (data,) in enumerate(rows)]
        shape = (len(frames), len(self.header.cameras), len(self.body.landmark_names))
        pixels = np.array([f["pixels"] for f in frames], dtype=np.float64).reshape(*shape, 2)
        return pixels, np.array([f["confidence"] for f in frames], dtype=np.float64).reshape(shape)

    @property
    def has_keypoints(self) -> bool:
        """Whether the keypoints it was made from were stored with it, and are of cameras."""
        if not self.header.cameras:
            return False
        with run_store.reading(self.file) as connection:
            return connection.execute("SELECT position FROM observation LIMIT 1").fetchone() is not None

    @property
    def pixels(self) -> np.ndarray:
        """(planned T, C, L, 2) keypoints the run was made from [px], NaN where missing; none if never stored."""
        return self._keypoints[0]

    @property
    def confidence(self) -> np.ndarray:
        """(planned T, C, L) of `pixels`."""
        return self._keypoints[1]

    @cached_property
    def markers(self) -> np.ndarray | None:
        """(planned T, M, 3) where the subject's markers were measured, in the world [m], NaN where missing; None of a
        run without."""
        if not self.header.points:
            return None
        with run_store.reading(self.file) as connection:
            rows = connection.execute("SELECT data FROM observation ORDER BY position").fetchall()
        frames = [self._keypoints_of(data, i).get("markers") for i, (data,) in enumerate(rows)]
        measured = [frame for frame in frames if frame is not None]
        return np.array(measured) if measured and len(measured) == len(frames) else None

    def _padded(self, name: str) -> np.ndarray:
        """An array of the hypotheses over all frames."""
        copied = [f[name].copy() if name in f else None for f in self._each()]  # a view would keep the whole frame
        return self._stacked(copied, RESULT_FIELDS[name])

    def _stacked(self, frames: Sequence[np.ndarray | None], field: Field) -> np.ndarray:
        """Arrays (K, ...) of all frames as one (T, K, ...), with nothing where a frame has fewer or none."""
        sizes = {**sizes_of(self.body), "K": self.hypothesis_count}
        out = field.nothing(len(frames), *(sizes[size] for size in field.shape))
        out = out.astype(np.result_type(out, *{a.dtype for a in frames if a is not None}))  # the longest text fits
        for t, array in enumerate(frames):
            if array is not None:
                out[t, : len(array)] = array
        return out

    def _along(self, per_mode: np.ndarray) -> np.ndarray:
        """Rows of the path; NaN for a frame without hypotheses."""
        out = np.full((per_mode.shape[0], *per_mode.shape[2:]), np.nan)
        some = self.path >= 0
        out[some] = per_mode[some, self.path[some]]
        return out


def landmarks_along(body: Body, q: np.ndarray) -> np.ndarray:
    """Landmarks (T, L, 3) in the world [m] of configurations q (T, nq), NaN where there is none."""
    points = np.full((len(q), len(body.landmark_names), 3), np.nan)
    for t in np.flatnonzero(np.isfinite(q).all(axis=1)):
        points[t] = body.landmarks(body.at(q[t]))
    return points


_MOST = 50_000_000  # entries that are filled up


def stacked(frames: Sequence[np.ndarray | None], source: Path, name: str) -> np.ndarray:
    """Arrays of T frames stacked to (T, ...); at least one of them is not missing.

    Missing entries are NaN, for which numbers and booleans become floats, or empty text.

    Raises
    ------
    InputError: some have more axes than others, or are text and others are not; or most of many entries would be
        filling. source, name: whose they are, for the message.
    """
    there = [a for a in frames if a is not None]
    text = {a.dtype.kind == "U" for a in there}
    if len({a.ndim for a in there}) > 1 or len(text) > 1:
        raise InputError(source, "is of different kinds in different frames", place=name, remedy="take frames singly")
    if len(there) == len(frames) and len({a.shape for a in there}) == 1:
        return np.stack(there)
    width = max(a.dtype.itemsize // 4 for a in there) if text == {True} else 1
    shape = (len(frames), *np.max([a.shape for a in there], axis=0, initial=0).astype(int).tolist())
    if np.prod(shape, dtype=float) * width > _MOST:
        raise InputError(source, f"would fill {shape} entries", place=name, remedy="take frames singly")
    out = np.full(shape, "", dtype=f"U{max(width, 1)}") if text == {True} else np.full(shape, np.nan)
    for t, array in enumerate(frames):
        if array is not None:
            filled = out[t : t + 1]
            filled[(slice(None), *map(slice, array.shape))] = array
    return out
