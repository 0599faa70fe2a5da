"""A run's motion without its fast part: the Butterworth filter on configurations.

The low-pass filter of movement analysis, of fourth order, without lag: a filter of second order is run forwards and
backwards (Winter, *Biomechanics and Motor Control of Human Movement*, 4th ed. 2009, section 2.2.4.4). Two passes would
let less through than one, so each gets a higher cut-off, by the factor (sqrt(2) - 1)^(-1/4) = 1 / 0.802 in the tangent
of the frequency; then the amplitude at the given cut-off is 1 / sqrt(2) after both.

Every joint is filtered by what it turns or slides, in its tangent space. A root is filtered by its position, entry by
entry, and by its quaternion: signs are made continuous, the four entries are filtered alike and brought back to unit
length. That is the mean of the neighbouring rotations with the filter's weights (chordal, Markley et al. 2007); a root
that turns steadily about an axis keeps turning, and a small oscillation is damped like that of a joint.

At its ends a motion is continued by its point reflection (for rotations R -> R0 R^-1 R0), which continues the motion
and alone does not move the first and last pose.

Frames need not be evenly spaced: where they are not, the motion is resampled by cubic splines at even times, filtered,
and resampled at its own times. The splines bridge frames without a pose, and pauses, of at most half a period of the
cut-off. At longer ones the motion is cut, and each part is filtered separately. Frames without a pose stay so. Frames
without observations have the pose that the tracker predicted or the smoother put there, and are filtered like others.

A motion at even times, for formats with a single rate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
from scipy.interpolate import CubicSpline

from estimator.runs.coordinates import JointEntry, joint_entries
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError, shown

_EVEN = 0.05  # share of a frame by which times may be off for a run to count as evenly spaced
_USUAL = 0.2  # by which steps may differ from the median, relatively, to count for the frame rate
_ROUNDING = 1e-6
_OUTSIDE = 1e-6  # rad or m by which a filtered value has to pass a limit to be reported
_VANISHED = 0.1  # length of a filtered quaternion from which its direction is the noise's
_PASSES = 2
_CORRECTION = (2.0 ** (1.0 / _PASSES) - 1.0) ** 0.25
_PERIODS = 3.0
"""Periods of the cut-off by which a signal is continued at both ends: the filter's start is then below 1e-7 of it."""


@dataclass(frozen=True)
class Filtering:
    """A motion that was filtered, and what was done to it.

    q (T, nq): configurations, NaN where there were none. cutoff, rate [Hz]: of the filter and of the frames.
    clamped: by joint, in how many frames the filter led beyond a limit, which was then taken.
    parts: how many parts were filtered separately. resampled: the frames are not evenly spaced.
    """

    q: np.ndarray
    cutoff: float
    rate: float
    clamped: Mapping[str, int]
    parts: int
    resampled: bool

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user, a sentence each."""
        notes = []
        if self.clamped:
            listed = ", ".join(f"{name} in {count} of {len(self.q)} frames" for name, count in self.clamped.items())
            notes.append(f"filtered values beyond joint limits were clipped to them: {listed}")
        if self.parts > 1:
            notes.append(f"frames are missing: {self.parts} parts were filtered by themselves")
        if self.resampled:
            notes.append(f"frames are not evenly spaced: they were filtered at an even {self.rate:g} a second")
        return tuple(notes)


def filtered(body: Body, q: np.ndarray, time: np.ndarray, cutoff: float) -> Filtering:
    """Configurations q (T, nq) at rising time (T,) [s] without what moves faster than the cut-off [Hz].

    Raises
    ------
    InputError: a cut-off that is not above zero, or not below half the frame rate.
    """
    known = np.flatnonzero(np.isfinite(q).all(axis=1))
    rate = frame_rate(time)
    _check(cutoff, rate)
    out = q.copy()
    parts = [part for part in np.split(known, _cuts(time[known], cutoff, rate)) if len(part) > 1]
    clocks = [_Clock.of(time[part], rate) for part in parts]
    for part, clock in zip(parts, clocks, strict=True):
        for entry in joint_entries(body):
            if not entry.follows:
                own = slice(entry.start, entry.start + entry.count)
                out[part, own] = _entry(entry, q[part, own], clock, cutoff)
    i = body.bounded_q
    beyond = np.maximum(body.lower[i] - out[:, i], out[:, i] - body.upper[i]) > _OUTSIDE
    for t in known:
        out[t] = body.clamp(out[t])
    clamped = {body.q_names[k]: int(count) for k, count in zip(i, beyond.sum(axis=0), strict=True) if count}
    return Filtering(out, cutoff, rate, clamped, len(parts), any(not clock.even for clock in clocks))


def frame_rate(time: np.ndarray) -> float:
    """Frames a second at time (T,) [s]: the usual one, also where some are missing; 0 where it cannot be computed."""
    steps = np.diff(time)
    usual = steps[np.abs(steps - np.median(steps)) <= _USUAL * np.median(steps)] if len(steps) else steps
    step = float(usual.mean()) if len(usual) else 0.0
    return 1.0 / step if step > 0.0 else 0.0


def evenly_spaced(time: np.ndarray) -> bool:
    """Whether frames at time (T,) [s], two at least, are off even times by a small share of a frame at most."""
    even = np.linspace(time[0], time[-1], len(time))
    return bool(np.abs(time - even).max() * (len(time) - 1) < _EVEN * (time[-1] - time[0]))


def _check(cutoff: float, rate: float) -> None:
    if not (np.isfinite(cutoff) and cutoff > 0.0):
        raise InputError("filter", f"{shown(cutoff)} Hz is not a cut-off frequency", remedy="6 is usual for walking")
    if rate > 0.0 and cutoff > (0.5 - _ROUNDING) * rate:
        problem = f"a cut-off of {cutoff:g} Hz is not below half the frame rate, {0.5 * rate:.4g} Hz"
        raise InputError("filter", problem, remedy="choose a lower one, 6 is usual for walking")


def _cuts(time: np.ndarray, cutoff: float, rate: float) -> np.ndarray:
    """Before which of the frames with a pose, at time (N,), a new part begins."""
    longest = max(0.5 / cutoff, 1.5 / rate) if rate > 0.0 else 0.0
    return np.flatnonzero(np.diff(time) > longest) + 1


@dataclass(frozen=True)
class _Clock:
    """own (N,), even_times (M,) [s]: of a part's frames, and evenly spaced over the same span. rate: of these a second.
    even: the two are the same."""

    own: np.ndarray
    even_times: np.ndarray
    rate: float
    even: bool

    @staticmethod
    def of(time: np.ndarray, rate: float) -> _Clock:
        span, count = float(time[-1] - time[0]), len(time)
        if evenly_spaced(time):
            return _Clock(time, time, (count - 1) / span, even=True)
        count = max(round(span * rate), 1) + 1
        return _Clock(time, np.linspace(time[0], time[-1], count), (count - 1) / span, even=False)


def _entry(entry: JointEntry, q: np.ndarray, clock: _Clock, cutoff: float) -> np.ndarray:
    """A joint's entries (N, count) filtered."""
    if entry.kind == "free":
        turned = _unit(_passed(_same_signs(q[:, 3:]), clock, cutoff, _turned_back), otherwise=q[:, 3:])
        return np.concatenate([_passed(q[:, :3], clock, cutoff, _mirrored), turned], axis=1)
    if entry.count in (2, 4):  # cosine and sine of an angle, in a plane after two lengths
        angle = np.unwrap(np.arctan2(q[:, -1], q[:, -2]))[:, None]
        lengths, angle = np.split(_passed(np.concatenate([q[:, :-2], angle], 1), clock, cutoff, _mirrored), [-1], 1)
        return np.concatenate([lengths, np.cos(angle), np.sin(angle)], axis=1)
    return _passed(q, clock, cutoff, _mirrored)


Reflection = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Samples (n, ...) on the other side of an end (...)."""


def _mirrored(end: np.ndarray, samples: np.ndarray) -> np.ndarray:
    return 2.0 * end - samples


def _turned_back(end: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """The reflection of unit quaternions xyzw."""
    return _product(_product(end, samples * [-1.0, -1.0, -1.0, 1.0]), end)


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products of quaternions xyzw (..., 4)."""
    vector = a[..., 3:] * b[..., :3] + b[..., 3:] * a[..., :3] + np.cross(a[..., :3], b[..., :3])
    scalar = a[..., 3:] * b[..., 3:] - np.sum(a[..., :3] * b[..., :3], axis=-1, keepdims=True)
    return np.concatenate([vector, scalar], axis=-1)


def _same_signs(quaternions: np.ndarray) -> np.ndarray:
    """The same rotations (N, 4), each with the sign that is nearer to the one before."""
    apart = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0
    return quaternions * np.where(np.cumsum(np.concatenate([[False], apart])) % 2, -1.0, 1.0)[:, None]


def _unit(quaternions: np.ndarray, otherwise: np.ndarray) -> np.ndarray:
    """Quaternions (N, 4) at unit length; those `otherwise` (N, 4) where a turn is so fast that nothing is left."""
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    return np.where(length > _VANISHED, quaternions / np.maximum(length, _VANISHED), otherwise)


def _passed(samples: np.ndarray, clock: _Clock, cutoff: float, reflection: Reflection) -> np.ndarray:
    """Samples (N, M) at the times of a clock, filtered; unchanged where the cut-off has no effect."""
    if cutoff > (0.5 - _ROUNDING) * clock.rate:
        return samples
    even = samples if clock.even else CubicSpline(clock.own, samples)(clock.even_times)
    extended = extension(cutoff, clock.rate)
    filtered = low_pass(_continued(even, extended, reflection), cutoff, clock.rate, extended)
    return filtered if clock.even else np.asarray(CubicSpline(clock.even_times, filtered)(clock.own))


def _continued(samples: np.ndarray, extended: int, reflection: Reflection) -> np.ndarray:
    """Samples (N, M) extended by a number of them at either end; a short motion is reflected more than once."""
    for _ in range(2):  # the beginning, then the end, which is the beginning of the reverse
        wanted = len(samples) + extended
        while len(samples) < wanted:
            count = min(wanted - len(samples), len(samples) - 1)
            samples = np.concatenate([reflection(samples[0], samples[count:0:-1]), samples])
        samples = samples[::-1]
    return samples


def gain(frequency: np.ndarray | float, cutoff: float, rate: float) -> np.ndarray:
    """Factor (...) of the amplitude of a sine of this frequency (...) [Hz]; cut-off and sampling rate [Hz]."""
    ratio = np.tan(np.pi * np.asarray(frequency) / rate) / _edge(cutoff, rate)
    return np.asarray(1.0 / (1.0 + ratio**4))


def extension(cutoff: float, rate: float) -> int:
    """Samples by which a signal has to be continued at both ends for `low_pass`."""
    return int(np.ceil(_PERIODS * rate / cutoff)) + 1


def low_pass(samples: np.ndarray, cutoff: float, rate: float, extended: int) -> np.ndarray:
    """Filtered samples (N, ...), the continuation (see `extension`) cut off again.

    samples (N + 2 extended, ...): evenly spaced, continued at both ends. cutoff [Hz] is below half the rate [Hz].
    """
    from scipy.signal import butter, sosfiltfilt  # takes long to import

    ends = 2.0 / np.pi * np.arctan(_edge(cutoff, rate))  # of half the rate
    filtered = sosfiltfilt(butter(2, ends, output="sos"), samples, axis=0, padtype=None)
    return cast(np.ndarray, filtered[extended : len(samples) - extended])


def _edge(cutoff: float, rate: float) -> float:
    """Tangent of the cut-off of one pass, as in the bilinear transform."""
    return float(np.tan(np.pi * cutoff / rate)) / _CORRECTION


LONGEST = 0.25  # s between frames over which a pose counts as seen
_SAME = 1e-6  # s by which a frame may be off an even time to count as it


class EvenMotion(NamedTuple):
    """time (K,) [s]: evenly spaced. q (K, nq): NaN where there is no pose. seen (K,) bool: frames of it on both sides
    were observed, and are at most `LONGEST` apart."""

    time: np.ndarray
    q: np.ndarray
    seen: np.ndarray


def even_motion(body: Body, q: np.ndarray, time: np.ndarray, seen: np.ndarray) -> EvenMotion:
    """Configurations q (T, nq) at rising time (T,) [s] at the usual rate of the frames, over the same span: unchanged
    where the frames are evenly spaced, else between neighbouring ones along the shortest way on the configuration
    manifold. seen (T,) bool: which frames were observed."""
    if len(time) < 3 or evenly_spaced(time):
        return EvenMotion(time, q, seen)
    rate = frame_rate(time)
    times = time[0] + np.arange(int((time[-1] - time[0]) * rate + _SAME * rate) + 1) / rate
    before = np.clip(np.searchsorted(time, times, side="right") - 1, 0, len(time) - 2)
    nearer = before + (times - time[before] > time[before + 1] - times)
    alone = np.abs(times - time[nearer]) < _SAME
    first, last = np.where(alone, nearer, before), np.where(alone, nearer, before + 1)
    step = time[last] - time[first]
    share = np.where(alone, 0.0, (times - time[first]) / np.where(alone, 1.0, step))
    there = np.isfinite(q).all(axis=1)
    known = there[first] & there[last]
    out = np.full((len(times), q.shape[1]), np.nan)
    out[known] = body.interpolated(q[first[known]], q[last[known]], share[known])
    return EvenMotion(times, out, known & seen[first] & seen[last] & (step <= LONGEST))
