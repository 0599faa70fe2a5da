"""`calibrate --check`: cameras that were calibrated otherwise, by a person who moves before them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.media.threads import one_thread
from estimator.data.rigs.bundle import RigState
from estimator.data.rigs.filmed import FilmedPerson
from estimator.data.rigs.first import triangulated
from estimator.data.rigs.lengths import SegmentLengths
from estimator.data.rigs.search import RigFit, RigViews, fitted_rig, rig_near
from estimator.data.rigs.steadiness import RigPart, changed_camera
from estimator.data.rigs.views import common_instants
from estimator.numerics.robust import typical_distance
from humanoid.kinematics.body import Body

_LENGTHS_STD = 0.2  # of the logarithms: people are of all sizes, and the cameras give the metres
_INSTANTS = 80
_BETTER = 1.15  # times that rays fit better where the cameras may stand otherwise: of right ones it is 1.08 or less


@dataclass(frozen=True)
class CheckedCamera:
    """error: how far keypoints are from where points of all cameras are seen, root mean square without outliers [px].
    turn [deg], shift [m]: by which the person places it otherwise than it was given, against the first; turn_std,
    shift_std: their deviations."""

    error: float
    turn: float
    turn_std: float
    shift: float
    shift_std: float


@dataclass(frozen=True)
class RigCheck:
    """The check of given cameras by a person.

    cameras: by name. gain: times that rays fit better where the cameras may stand otherwise, near 1 of right ones.
    size: of the person by these cameras, over the body's. moved: the camera that stands otherwise, or the two of which
    one does; none where all agree. notes: what the user should know.
    """

    cameras: dict[str, CheckedCamera]
    gain: float
    size: float
    moved: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """Whether no camera is found moved by the person."""
        return not self.moved


@one_thread()
def check_by_person(
    body: Body,
    tracks: Mapping[str, KeypointTrack],
    cameras: Mapping[str, Camera],
    times: Mapping[str, np.ndarray],
) -> RigCheck:
    """The agreement of cameras with one person's keypoints in each, in the form of `calibrate_by_person`.

    Rays of right cameras meet about as well as those of cameras that are placed by the person; where they meet much
    worse, the camera is named that lets them meet when it alone is placed again. times [s]: of the frames, on one
    clock.

    Raises
    ------
    InputError: fewer than two cameras; too little that two cameras see at once.
    """
    known = {name: replace(camera, focal_std=0.0) for name, camera in cameras.items()}
    seen = FilmedPerson.of(body, tracks, known, times)
    lengths = seen.lengths._replace(std=np.full_like(seen.lengths.std, _LENGTHS_STD))
    views = RigViews.of(seen.views, seen.joints, clocks_known=True)
    no_lag = np.zeros(len(seen.names))
    instants = common_instants(views.views, no_lag, _INSTANTS)
    if not len(instants):
        raise seen.nothing()
    given = _given([cameras[name] for name in seen.names], lengths)
    part = RigPart.of(views, lengths, given, no_lag, instants)
    fits = [rig_near(views, lengths, no_lag, part.state), fitted_rig(views, lengths, [no_lag])]
    best, own = min(
        ((fit, _cost(views, lengths, fit, instants)) for fit in fits if fit is not None), key=lambda pair: pair[1]
    )
    gain = part.before / min(own, part.cost)
    move = changed_camera(given, part.seen, lengths, 0.0) if gain > _BETTER else None
    moved = tuple(seen.names[c] for c in move.cameras) if move is not None and move.matters else ()
    checked = dict(zip(seen.names, _cameras(given, best, [cameras[n].K[0, 0] for n in seen.names]), strict=True))
    size = lengths.size(triangulated(part.seen.rays, given.R, given.t, range(len(given.R))))
    if not np.isfinite(size):  # what two cameras see at once shows no segment's length
        raise seen.nothing()
    return RigCheck(checked, gain, size, moved)


def _given(cameras: Sequence[Camera], lengths: SegmentLengths) -> RigState:
    """The rig as it was calibrated, in the first camera's frame, without points."""
    first = cameras[0]
    R = np.array([camera.R_camera_world @ first.R_camera_world.T for camera in cameras])
    t = np.array([camera.t_camera_world for camera in cameras]) - R @ first.t_camera_world
    points = np.zeros((0, len(lengths.landmark), 3))
    late, radial = np.zeros((2, len(cameras)))
    return RigState(R, t, late, np.ones(len(cameras)), radial, lengths.mean.copy(), points)


def _cost(views: RigViews, lengths: SegmentLengths, fit: RigFit, instants: np.ndarray) -> float:
    """The cost per ray of a rig, at the noise used before."""
    return RigPart.of(views, lengths, fit.state, fit.late, instants).cost


def _cameras(given: RigState, fit: RigFit, focal: Sequence[float]) -> list[CheckedCamera]:
    """Each camera against a rig placed by the person, at the size of the given one."""
    centres, own = (-np.einsum("cji,cj->ci", state.R, state.t) for state in (given, fit.state))
    scale = float(np.sum(own * centres) / max(np.sum(own * own), 1e-12))
    turns = np.degrees(Rotation.from_matrix(fit.state.R @ np.swapaxes(given.R, 1, 2)).magnitude())
    deviations = fit.deviations(scale)
    checked = []
    for c, off in enumerate(np.linalg.norm(fit.misfits, axis=3)):
        turn_std, shift_std = np.linalg.norm(deviations[c, :3]), np.linalg.norm(deviations[c, 3:6])
        error = focal[c] * typical_distance(off)
        shift = np.linalg.norm(scale * own[c] - centres[c])
        figures = (error, turns[c], np.degrees(turn_std), shift, shift_std)
        checked.append(CheckedCamera(*map(float, figures)))
    return checked
