"""`calibrate` without a board: cameras from the keypoints of a person who moves before them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.clock_rates import Lags
from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.media.threads import one_thread
from estimator.data.moving_rays import MovingRays, speed_disagreement
from estimator.data.people.up_direction import up_direction
from estimator.data.rigs.bundle import RigState
from estimator.data.rigs.filmed import FILM, FilmedPerson
from estimator.data.rigs.posing import posed_rig
from estimator.data.rigs.search import RigFit, RigViews, fitted_rig
from estimator.data.rigs.steadiness import CameraMove, camera_move, strange_cameras
from estimator.data.rigs.views import JointView
from estimator.data.synchronisation import LONGEST, PEAK, SURE_MARGIN, synchronised
from estimator.numerics.robust import typical_distance
from estimator.numerics.vectors import angle_between
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError

UNSURE_TURN, UNSURE_SHIFT = 1.5, 0.04  # degrees; of the distance to the person: deviations that are reported
_COMMON = 0.5  # of the shorter clip: what clips have in common at least
_FRAMES = 1.5  # by which clocks from two sources may differ
_HOPELESS = 12.0  # degrees: larger deviations are not a calibration
_SWAPPED = 0.05  # share of the frames
_SHORT = 8.0  # s: fewer leave the cameras in doubt
_PLACE, _LINE = 0.2, 0.08  # m: standard deviations of a path that stays in one place, and that is a line
_FLAT = 0.06  # m: of points in a plane, across it
NARROW = 25.0
"""Degrees between cameras, seen from the person, below which they hardly constrain depth."""
_LOW = 10.0  # percentile of the ankles' heights that is that of feet on the floor
_LEVEL = np.radians(60.0)  # between the person's up and the cameras', at most
_SEEN = 50  # ankles
_STEP = 1.0 / 30.0  # s: of the instants, at least
_TRUSTED = 1.0  # s in common at which a lag has half its weight
_SHORTEST = 0.3  # s in common
_OTHERS = 3


@dataclass(frozen=True)
class PersonCalibration:
    """Cameras that were found from a person.

    cameras: by name, in a world whose z points up, in metres, with the floor at 0; each with its `deviations` against
    the first. offsets: when each camera's first frame was taken after the first one's times [s]; offset_stds [s]: their
    deviations, 0 of what was known. radial_stds: deviations of the radial terms k1, 0 of what was known, or what the
    motion does not show and is left at 0. residuals: from keypoints to where the points of all cameras are seen, (T, J,
    2) [px] of a picture without the lens's distortion, NaN where nothing was seen. exchanged: share of each camera's
    frames whose sides were exchanged. names (J), points (T, J, 3) [m]: of the person, in the world, at times (T,) [s]
    of the first camera's clock.
    notes: what the user should know. doubtful: cameras that were moved, or see another person, according to a note.
    """

    cameras: dict[str, Camera]
    offsets: dict[str, float]
    offset_stds: dict[str, float]
    radial_stds: dict[str, float]
    residuals: dict[str, np.ndarray]
    exchanged: dict[str, float]
    names: tuple[str, ...]
    times: np.ndarray
    points: np.ndarray
    notes: tuple[str, ...]
    doubtful: tuple[str, ...] = ()

    @property
    def turn_stds(self) -> dict[str, float]:
        """Deviations of each camera's rotation against the first [deg]."""
        return {name: float(np.degrees(camera.turn_std)) for name, camera in self.cameras.items()}

    @property
    def shift_stds(self) -> dict[str, float]:
        """Deviations of each camera's place against the first [m]."""
        return {name: camera.place_std for name, camera in self.cameras.items()}

    @property
    def focal_stds(self) -> dict[str, float]:
        """Deviations of the logarithms of the focal lengths, 0 of those that were given."""
        return {name: camera.focal_std for name, camera in self.cameras.items()}

    @property
    def errors(self) -> dict[str, float]:
        """The typical distance of keypoints from the projected points of all cameras, see `typical_distance` [px]."""
        return {name: float(typical_distance(off)) for name, off in self.distances.items()}

    @property
    def distances(self) -> dict[str, np.ndarray]:
        """Lengths of the residuals, (T, J) [px]."""
        return {name: np.linalg.norm(off, axis=2) for name, off in self.residuals.items()}

    @property
    def unsure(self) -> tuple[str, ...]:
        """The cameras whose deviations are large enough to be reported, and the doubtful ones."""
        most = UNSURE_SHIFT * self.distance
        return tuple(
            n
            for n in self.cameras
            if self.turn_stds[n] > UNSURE_TURN or self.shift_stds[n] > most or n in self.doubtful
        )

    def with_doubt(self, cameras: Sequence[str], note: str) -> PersonCalibration:
        """The calibration with doubtful cameras, with a note of the reason before all others."""
        return replace(self, doubtful=tuple(cameras), notes=(note, *self.notes))

    @property
    def sure(self) -> bool:
        """Whether no camera is uncertain."""
        return not self.unsure

    @property
    def distance(self) -> float:
        """The median distance from the first camera to the person [m]."""
        first = next(iter(self.cameras.values()))
        return float(np.nanmedian(np.linalg.norm(self.points - first.centre_world, axis=2)))


@one_thread()
def calibrate_by_person(
    body: Body,
    tracks: Mapping[str, KeypointTrack],
    lenses: Mapping[str, Camera],
    times: Mapping[str, np.ndarray],
    *,
    clocks_known: bool = False,
    size: float = 1.0,
) -> PersonCalibration:
    """Cameras and clocks from one person's keypoints in each.

    body: whose landmarks the keypoints are, a person of about these proportions. lenses: of each camera; where it
    stands does not count, and its focal length is fitted where it has a deviation. times [s]: of the keypoints' frames,
    by each camera's clock. clocks_known: whether these are one clock. size: of the person over the body.

    Raises
    ------
    InputError: fewer than two cameras; too little that two cameras see at once; no motion that determines where they
    stand; clocks that cannot be determined.
    """
    seen = FilmedPerson.of(body, tracks, lenses, times)
    names, lengths, views = seen.names, seen.lengths, seen.views
    lags = [np.zeros(len(names))] if clocks_known else clock_lags(views)
    rays = RigViews.of(views, seen.joints, clocks_known=clocks_known)
    fit = fitted_rig(rays, lengths, lags)
    if fit is None:
        raise seen.nothing()
    _check(fit)
    fit = posed_rig(body, fit, lengths)
    rig = _calibration(body, names, lenses, seen.joints, fit, size)
    if not clocks_known:
        _check_clocks(rig, views, fit, lengths.mirror)
    move = camera_move(rays, lengths, fit)
    if move is not None:
        return rig.with_doubt([names[c] for c in move.cameras], _moved(names, move))
    strange = [names[c] for c in strange_cameras(rays, lengths, fit)]
    return rig.with_doubt(strange, _inconsistent_note(strange)) if strange else rig


def _moved(names: Sequence[str], move: CameraMove) -> str:
    which = " or ".join(names[c] for c in move.cameras)
    return (
        f"{which} was moved at about {move.after:.1f} s of the clock of {names[0]}: no placement is right for the whole"
        " clip; cut the clips there"
    )


def _inconsistent_note(names: Sequence[str]) -> str:
    *others, name = names
    which = f"{name} and {others[0]} do not fit each other" if others else f"{name} does not fit the others"
    return (
        f"{which}: does it see another person (--person {name}=NUMBER), is its clock wrong (--offset {name}=SECONDS),"
        " are its keypoints poor? Else leave it out"
    )


def _check(fit: RigFit) -> None:
    """Raise InputError where the motion does not determine where the cameras stand."""
    turns = np.array([np.degrees(np.sqrt(np.trace(fit.unsure.own(c)[:3, :3]))) for c in range(len(fit.late))])
    if not np.isfinite(turns).all() or turns.max() > _HOPELESS:
        points, centres = fit.state.points, -np.einsum("cji,cj->ci", fit.state.R, fit.state.t)
        why = in_words(causes(points, float(np.ptp(fit.instants)), centres, int(np.argmax(turns))))
        problem = f"the person's motion does not determine where the cameras stand, to {turns.max():.0f} degrees{why}"
        raise InputError("cameras", problem, remedy=FILM)


def _check_clocks(
    rig: PersonCalibration, views: Sequence[JointView], fit: RigFit, mirror: np.ndarray
) -> None:  # fmt: skip
    """Raise InputError unless rays that meet, and speeds, give the same clocks, at which the clips overlap by half."""
    clocks = [view.times + offset for view, offset in zip(views, rig.offsets.values(), strict=True)]
    right = [
        _right_way(v.pixels, own, flips, fit, mirror) for v, own, flips in zip(views, clocks, fit.flips, strict=True)
    ]
    told = synchronised(list(rig.cameras.values()), right, clocks)
    most = _FRAMES * max(float(np.median(np.diff(view.times))) for view in views)
    agree = (told.margin >= SURE_MARGIN) & (np.abs(told.offsets) <= most) & (fit.unsure.late_std <= most)
    first = clocks[0]
    for c, own in enumerate(clocks):
        common = min(first[-1], own[-1]) - max(first[0], own[0])
        agree[c] &= common >= _COMMON * min(np.ptp(first), np.ptp(own))
    if not agree.all():
        names = [name for name, sure in zip(rig.cameras, agree, strict=True) if not sure]
        problem = f"when {', '.join(names)} started is not certain before the cameras are placed"
        if told.rates is not None and told.rates.differ:
            steps = [float(np.median(np.diff(view.times))) for view in views]
            at = [
                f"{n} at about {1.0 / (t * s):.2f}"
                for n, t, s in zip(rig.cameras, steps, told.rates.scales, strict=True)
            ]
            problem += (
                f": the clocks run at different rates, frames per second: {', '.join(at)}; give the true ones as fps"
            )
        raise InputError("cameras", problem, remedy=f"--offset {names[0]}=SECONDS gives it, or {FILM}")


def _right_way(
    pixels: np.ndarray, times: np.ndarray, flips: np.ndarray, fit: RigFit, mirror: np.ndarray
) -> np.ndarray:  # fmt: skip
    """Pixels (N, J, 2) at times (N,) [s] whose sides are exchanged where they are at the nearest instant."""
    middles = 0.5 * (fit.instants[1:] + fit.instants[:-1])
    return np.where(flips[np.searchsorted(middles, times), None, None], pixels[:, mirror], pixels)


def _calibration(
    body: Body, names: Sequence[str], lenses: Mapping[str, Camera], joints: Sequence[str], fit: RigFit, size: float
) -> PersonCalibration:
    state = fit.state
    world = rig_world(body, joints, state, fit.instants, size)
    deviations = fit.deviations(size)
    cameras = {name: _placed(lenses[name], c, fit, world, deviations[c]) for c, name in enumerate(names)}
    result = PersonCalibration(
        cameras=cameras,
        offsets={name: -float(fit.late[c]) + 0.0 for c, name in enumerate(names)},
        offset_stds=_by_name(names, fit.unsure.late_std),
        radial_stds=_by_name(names, fit.unsure.radial_std),
        residuals={name: lenses[name].K[0, 0] * off for name, off in zip(names, fit.misfits, strict=True)},
        exchanged=_by_name(names, _exchanged(fit.flips)),
        names=tuple(joints),
        times=fit.instants,
        points=world.points(state.points),
        notes=(),
    )
    return replace(result, notes=tuple(_notes(result, world)))


def _by_name(names: Sequence[str], values: np.ndarray) -> dict[str, float]:
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def _placed(lens: Camera, c: int, fit: RigFit, world: RigWorld, deviations: np.ndarray) -> Camera:
    R, t = world.camera(fit.state.R[c], fit.state.t[c])
    K = lens.K.copy()
    K[:2, :2] *= fit.state.focal[c]
    focal_std, distortion = float(np.linalg.norm(deviations[6])), lens.distortion
    if fit.rays.radial_std[c] > 0.0:
        distortion = np.array([fit.state.radial[c], 0.0, 0.0, 0.0, 0.0])
    return replace(
        lens, K=K, distortion=distortion, R_camera_world=R, t_camera_world=t, focal_std=focal_std, deviations=deviations
    )


def _exchanged(flips: np.ndarray) -> np.ndarray:
    """Shares (C,); which of two cameras is right is undecidable: the one that is so in fewer frames."""
    share = flips.mean(axis=1)
    return np.minimum(share, 1.0 - share)


def _notes(rig: PersonCalibration, world: RigWorld) -> list[str]:
    notes = []
    centres = np.array([camera.centre_world for camera in rig.cameras.values()])
    seconds = float(rig.times[-1] - rig.times[0])
    unsure = rig.unsure
    for c, name in enumerate(rig.cameras):
        if name in unsure:
            why = in_words(causes(rig.points, seconds, centres, c))
            sure = f"{rig.turn_stds[name]:.1f} degrees and {100.0 * rig.shift_stds[name]:.0f} cm"
            notes.append(f"the place of {name} is uncertain by {sure}{why}: {FILM}")
        elif c > 0 and is_narrow(rig.points, centres, c):
            notes.append(
                f"{name} looks from the same side as the others, within {NARROW:.0f} degrees: its errors are up to"
                " twice its deviations; film from 40 degrees apart or more"
            )
    for name, share in rig.exchanged.items():
        if share > _SWAPPED:
            notes.append(f"{name}: left and right are exchanged in {share:.0%} of the frames, beside the other cameras")
    for name, camera in rig.cameras.items():
        if rig.focal_stds[name] > 0.0:
            length, std = camera.K[0, 0], rig.focal_stds[name]
            notes.append(f"{name}: a focal length of {length:.0f} px (+-{std:.0%}) is found from the person")
        if rig.radial_stds[name] > 0.0:
            sure = f"{camera.distortion[0]:.3f} (+-{rig.radial_stds[name]:.3f})"
            notes.append(f"{name}: its lens bends lines, by a radial term k1 of {sure}, as the motion shows")
    if world.up_from == "cameras":
        notes.append("up is taken from how the cameras are held: no one stands upright long enough")
    elif not world.up_sure:
        notes.append(
            "which way is up is known from the person's balance, but not to two degrees; joint angles are the same"
        )
    return notes


def causes(points: np.ndarray, seconds: float, centres: np.ndarray, c: int) -> list[str]:
    """The reason to doubt camera c, as text; none where nothing stands out.

    points (T, J, 3) [m]: of the person, NaN where unknown, over so many seconds. centres (C, 3) [m]: of the cameras.
    """
    named = [f"the clips share {seconds:.1f} s"] if seconds < _SHORT else []
    path = _spread(np.nanmean(points[np.isfinite(points).any(axis=(1, 2))], axis=1))
    if path[0] < _PLACE:
        named.append("the person stays in one place")
    elif path[1] < _LINE:
        named.append("the person moves along one line")
    if _spread(points[np.isfinite(points).all(axis=2)])[2] < _FLAT:
        named.append("all points are nearly in one plane")
    if is_narrow(points, centres, c):
        named.append("it looks from the same side as the others")
    return named


def is_narrow(points: np.ndarray, centres: np.ndarray, c: int) -> bool:
    """Whether camera c looks from the same side as all others; see `causes`."""
    ways = centres - np.nanmean(points, axis=(0, 1))
    return bool((np.degrees(angle_between(ways[c], np.delete(ways, c, axis=0))) < NARROW).all())


def in_words(named: Sequence[str]) -> str:
    """A part of a sentence, empty for none."""
    *others, last = named or [""]
    return f" ({', '.join(others)} and {last})" if others else f" ({last})" if last else ""


def _spread(points: np.ndarray) -> np.ndarray:
    """Standard deviations (3,) [m] of points (N, 3) along their principal axes, the largest first."""
    off = points - points.mean(axis=0)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(off.T @ off / len(off))[::-1], 0.0)))


@dataclass(frozen=True)
class RigWorld:
    """R_world_rig (3, 3), t_world_rig (3,) [m]: x_world = R size x_rig + t, of the world from the first camera's frame.
    size: metres in a unit of that frame. up_from: source of the up direction, "person" or "cameras"; up_sure: whether
    the person's balance and the floor determine it to about two degrees."""

    R_world_rig: np.ndarray
    t_world_rig: np.ndarray
    size: float
    up_from: str
    up_sure: bool = False

    def camera(self, R: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """R_camera_world and t_camera_world of a camera R, t in the rig's frame."""
        R_camera_world = R @ self.R_world_rig.T
        return R_camera_world, self.size * t - R_camera_world @ self.t_world_rig

    def points(self, points: np.ndarray) -> np.ndarray:
        """Points (..., 3) of the rig's frame in the world."""
        return self.size * points @ self.R_world_rig.T + self.t_world_rig


def rig_world(
    body: Body, names: Sequence[str], state: RigState, instants: np.ndarray, size: float
) -> RigWorld:  # fmt: skip
    """The world in which the person stands: up by balance and floor, or as the cameras are held; x is level along the
    first camera's axis; the origin is on the floor under the middle of the person's places."""
    level = -state.R[:, 1].mean(axis=0)
    level /= np.linalg.norm(level)
    told = up_direction(names, size * state.points, instants)
    by_person = told is not None and float(told.direction @ level) > np.cos(_LEVEL)
    up = told.direction if told is not None and by_person else level
    ahead = np.array([0.0, 0.0, 1.0]) - up[2] * up
    ahead = ahead / np.linalg.norm(ahead) if np.linalg.norm(ahead) > 0.1 else np.cross([1.0, 0.0, 0.0], up)
    R = np.stack([ahead, np.cross(up, ahead), up])
    places = size * state.points @ R.T
    middle = np.nanmedian(places.reshape(-1, 3), axis=0)
    middle[2] = _floor(body, names, places, size)
    sure = by_person and told is not None and told.sure
    return RigWorld(R, -middle, size, "person" if by_person else "cameras", sure)


def _floor(body: Body, names: Sequence[str], places: np.ndarray, size: float) -> float:
    """Height of the floor under places (T, J, 3) [m]: that of low ankles less an ankle's own; of the lowest place where
    there are none."""
    ankles = [i for i, name in enumerate(names) if name.endswith("_ankle")]
    heights = places[:, ankles, 2]
    heights = heights[np.isfinite(heights)]
    if len(heights) < _SEEN:
        return float(np.nanmin(places[..., 2]))
    lowest = FloorDistances(body, np.array([0.0, 0.0, 1.0]), 0.0).lowest(body.placed(body.neutral[None]))[0]
    own = body.landmarks(body.at(body.neutral))[[body.landmark_names.index(names[i]) for i in ankles], 2].mean()
    above = float(own - lowest) if np.isfinite(lowest) else 0.0
    return float(np.percentile(heights, _LOW)) - size * above


def clock_lags(views: Sequence[JointView]) -> list[np.ndarray]:
    """Delays of the clocks (C,) [s], the first one's 0, at which all speeds agree: the best, then
    others in which one clock has another lag that is better than its neighbours, as walking looks alike a stride later.
    None where no one moves, or no two cameras have a time in common."""
    step = max(_STEP, *(float(np.median(np.diff(view.times))) for view in views))
    begin, end = min(view.times[0] for view in views), max(view.times[-1] for view in views)
    grid = np.arange(begin, end + 1.5 * step, step)
    logs = [MovingRays.of(v.camera, v.pixels, v.times, grid).log_speed for v in views]
    most = min(round(LONGEST / step), len(grid) - 1)
    pairs = list(combinations(range(len(views)), 2))
    table = np.array([_table(logs[a], logs[b], most, step) for a, b in pairs])
    if np.ptp(table) == 0.0:
        return []
    a, b = (np.array([pair[k] for pair in pairs]) for k in range(2))
    lags = Lags(a, b, table, most)
    best = lags.best(len(views), [0])
    return [step * each.astype(float) for each in (best, *_others(lags, best, step))]


def _others(lags: Lags, best: np.ndarray, step: float) -> list[np.ndarray]:
    """The next best, in which one clock is read otherwise."""
    others: list[tuple[float, np.ndarray]] = []
    for c in range(1, len(best)):
        options = np.repeat(best[None], 2 * lags.most + 1, axis=0)
        options[:, c] = np.arange(-lags.most, lags.most + 1)
        costs = np.array([lags.of(option) for option in options])
        inner = np.flatnonzero((costs[1:-1] < costs[:-2]) & (costs[1:-1] < costs[2:])) + 1
        inner = inner[np.abs(options[inner, c] - best[c]) * step > PEAK]
        others += [(costs[i], options[i]) for i in inner[np.argsort(costs[inner])][:_OTHERS]]
    return [option for _, option in sorted(others, key=lambda pair: pair[0])[:_OTHERS]]


def _table(first: np.ndarray, second: np.ndarray, most: int, step: float) -> np.ndarray:
    """The evidence against each lag (2 most + 1,) of the second camera, from logarithms of speeds (T, J): half the
    logarithm of what the one's leave of the variance of the other's, drawn to the usual where little is in common."""
    values = np.zeros(2 * most + 1)
    for lag in range(-most, most + 1):
        i = np.arange(max(0, -lag), len(first) - max(0, lag))
        a, b = first[i], second[i + lag]
        seen = np.isfinite(a) & np.isfinite(b)
        common = step * float(np.count_nonzero(seen.any(axis=1)))
        if common < _SHORTEST:
            continue
        values[lag + most] = speed_disagreement(a, b, seen) * common / (common + _TRUSTED)
    return values
