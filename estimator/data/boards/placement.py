"""Placement of several cameras by one board: the one that most pictures support, then everything together.

A view of a flat board has two solutions, and in a small or far board both fit nearly as well (Collins and Bartoli, IJCV
2014). Which are true is decided over all views: the relative placements of the cameras have to agree.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.data.boards.adjustment import (
    Adjustment,
    Pose,
    adjust,
    angle_between,
    chained,
    corner_residuals,
    inverse,
)
from estimator.data.boards.board import Board, BoardSighting
from estimator.data.boards.lens import BoardPose, LensFit
from estimator.data.cameras.camera import Camera
from humanoid.support.errors import InputError

MOST_FRAMES = 40  # with boards that hold the cameras together
DOUBTED = 20.0  # twice the difference of log-likelihoods below which another solution fits as well
FEWER_STEPS = 15  # of the adjustment of another solution
UNSURE_TURN, UNSURE_SHIFT = 1.0, 0.02  # degrees; of the distance between two cameras: deviations that are reported
SAME = 2.0  # degrees, within which two solutions are one
FILM = "tilt the board more, bring it nearer, and carry it through where both cameras see it"
_TURN = 10.0  # degrees between two placements at which one supports the other half as much
_SHIFT = 0.2  # of the board's distance, the same
_CLEAR = 100.0  # twice the difference of log-likelihoods from which one solution of a view alone is taken
_LEAST_NOISE = 0.1  # px
_LEAST_SUPPORT = 0.3  # of the best placement's, of others that are considered
_MOST = 4  # placements of a pair
R_WORLD_BOARD = np.diag([1.0, -1.0, -1.0])
"""The world of a board that lies on the floor, face up: origin at its first inner corner (of a ChArUco board at its
outer corner), x along its columns, y against its rows, z up out of its face."""
MIRRORED = 5.0  # degrees between two solutions that differ
LEVEL = 60.0  # degrees between up out of the floor and up in the pictures, on average, that are reported
UPRIGHT = 0.3  # by which cameras have to be more upright in a solution that fits a little worse
AXES = {"x": (0, 1), "-x": (0, -1), "y": (1, 1), "-y": (1, -1), "-z": (2, -1)}


def place_cameras(
    fits: Mapping[str, LensFit], board: Board, views: Sequence[BoardSighting], origin: int
) -> tuple[dict[str, Camera], dict[str, float], list[str]]:
    """The cameras in the world of the board in frame `origin`, the root mean square distance of the corners in each
    from where the board is that all of them see [px], and notes on what is in doubt.

    Lenses are kept; cameras, and the board in every frame that two cameras saw, are moved until the corners of all
    fit best (bundle adjustment, soft L1 beyond 1 px).

    Raises
    ------
    InputError: a camera that shares no board with the others, not even by a chain of them.
    """
    rig = _Rig(fits, board, _shared(fits, views, origin), origin)
    best, notes = rig.best()
    floor, said = choose_floor(rig.floors(best), best.cameras, DOUBTED, origin)
    notes += said + _unsure(best, origin)
    placed = {name: in_world(fits[name].camera, pose, floor) for name, pose in best.cameras.items()}
    notes += floor_notes(placed, origin)
    errors = {}
    for name, fit in fits.items():
        distances = [
            corner_residuals(
                fit.camera, best.cameras[name], floor if v.frame == origin else best.boards[v.frame], board, v
            )
            for v in rig.views
            if v.camera == name
        ]
        errors[name] = float(np.sqrt(2.0 * np.mean(np.square(np.concatenate(distances)))))
    return {name: placed[name] for name in fits}, errors, notes


def _shared(fits: Mapping[str, LensFit], views: Sequence[BoardSighting], origin: int) -> list[BoardSighting]:
    """Views of the frames that several cameras saw, and of the origin; evenly some where there are many."""
    posed = [v for v in views if v.frame in fits[v.camera].poses]
    frames = sorted({v.frame for v in posed})
    several = [f for f in frames if sum(v.frame == f for v in posed) > 1]
    kept = (
        {several[i] for i in np.unique(np.linspace(0, len(several) - 1, MOST_FRAMES).astype(int))} if several else set()
    )
    return [v for v in posed if v.frame in kept | {origin}]


@dataclass
class _Rig:
    """Cameras and the views that hold them together; its world is the frame of a camera that sees the origin."""

    fits: Mapping[str, LensFit]
    board: Board
    views: list[BoardSighting]
    origin: int
    lenses: dict[str, Camera] = field(init=False)
    poses: dict[str, dict[int, list[BoardPose]]] = field(init=False)
    links: list[tuple[str, str, list[tuple[Pose, float]]]] = field(init=False)

    def __post_init__(self) -> None:
        self.lenses = {name: fit.camera for name, fit in self.fits.items()}
        self.poses = {}
        for name, fit in self.fits.items():
            of = candidates(fit, len(self.board.points))
            self.poses[name] = {v.frame: of[v.frame] for v in self.views if v.camera == name}
        self.links = self._tree()

    def _tree(self) -> list[tuple[str, str, list[tuple[Pose, float]]]]:
        """Pairs of cameras that reach all from the first, each with a placement that most frames support: the camera
        nearer the first, the other, placements of the former from the latter."""
        reached = [min((n for n in self.fits if self.origin in self.poses[n]), key=lambda n: self.fits[n].rms)]
        pairs: dict[tuple[str, str], list[tuple[Pose, float]]] = {}
        links = []
        while len(reached) < len(self.fits):
            left = [name for name in self.fits if name not in reached]
            for pair in ((a, b) for a in reached for b in left):
                if pair not in pairs:
                    pairs[pair] = placements(self.poses[pair[0]], self.poses[pair[1]])
            a, b = max(((a, b) for a in reached for b in left), key=lambda p: pairs[p][0][1] if pairs[p] else 0.0)
            if not pairs[a, b]:
                problem = f"there is no frame in which {', '.join(left)} and {', '.join(reached)} see the board"
                remedy = "carry it through where their views meet; the pictures of all cameras have to be of the same"
                raise InputError("calibrate", problem, remedy=f"{remedy} instants")
            links.append((a, b, pairs[a, b]))
            reached.append(b)
        return links

    def best(self) -> tuple[Adjustment, list[str]]:
        """The adjusted poses that fit best of all placements, and which others fit as well."""
        choice = [0] * len(self.links)
        best, notes = self._adjusted(choice), []
        unsettled = [several[1][1] / several[0][1] if len(several) > 1 else 0.0 for _, _, several in self.links]
        for i in np.argsort(-np.array(unsettled), kind="stable"):  # the others hold while the least sure is chosen
            a, b, several = self.links[i]
            doubted = False
            for k in range(1, len(several)):
                other = self._adjusted([*choice[:i], k, *choice[i + 1 :]], most_steps=FEWER_STEPS)
                better, worse = sorted((best, other), key=lambda adjustment: adjustment.cost)
                close = 2.0 * (worse.cost - better.cost) < DOUBTED * better.noise**2
                if self._differ(best, other, a, b):
                    doubted = close or (doubted and better is best)
                    if close and upright(worse.cameras) > upright(better.cameras) + UPRIGHT:
                        better = worse
                if better is other:
                    choice[i], best = k, other
            if doubted:
                notes.append(f"where {b} stands is in doubt: the mirrored solution of the board fits as well: {FILM}")
        return self._converged(best, 50), notes

    def _differ(self, x: Adjustment, y: Adjustment, a: str, b: str) -> bool:
        """Whether two solutions have the camera b turned otherwise to a."""
        relative = [chained(solution.cameras[a], inverse(solution.cameras[b])) for solution in (x, y)]
        return angle_between(*relative) > SAME

    def _adjusted(self, choice: Sequence[int], most_steps: int = 50) -> Adjustment:
        cameras: dict[str, Pose] = {}
        for (a, b, several), k in zip(self.links, choice, strict=True):
            cameras.setdefault(a, (np.eye(3), np.zeros(3)))
            cameras[b] = chained(inverse(several[k][0]), cameras[a])
        if not cameras:
            cameras = {name: (np.eye(3), np.zeros(3)) for name in self.fits}
        boards = {frame: self.boards(cameras, frame)[0][1] for frame in sorted({v.frame for v in self.views})}
        return self._converged(Adjustment(cameras, boards, np.inf, 0.0, {}), most_steps)

    def _converged(self, at: Adjustment, most_steps: int) -> Adjustment:
        """Adjusted, and again where a board fits better mirrored."""
        for _ in range(3):
            moved: list[str | int] = [*list(at.cameras)[1:], *at.boards]
            at = adjust(self.lenses, self.board, self.views, at.cameras, at.boards, moved=moved, most_steps=most_steps)
            boards = {frame: self.boards(at.cameras, frame, at.boards[frame])[0][1] for frame in at.boards}
            if all(angle_between(boards[frame], at.boards[frame]) < SAME for frame in boards):
                break
            at = Adjustment(at.cameras, boards, at.cost, at.noise, at.covariances)
        return at

    def boards(self, cameras: Mapping[str, Pose], frame: int, now: Pose | None = None) -> list[tuple[float, Pose]]:
        """Costs and poses of the board in a frame where cameras stay: the best from each of its views' solutions."""
        views = [v for v in self.views if v.frame == frame]
        starts = [] if now is None else [now]
        for v in views:
            for pose in self.poses[v.camera][frame]:
                start = chained(inverse(cameras[v.camera]), pose[:2])
                if all(angle_between(start, s) > SAME for s in starts):
                    starts.append(start)
        if now is not None and len(starts) == 1:
            return [(0.0, now)]
        some = {v.camera: cameras[v.camera] for v in views}
        fitted = [adjust(self.lenses, self.board, views, some, {frame: s}, moved=[frame], most_steps=8) for s in starts]
        return sorted(((f.cost, f.boards[frame]) for f in fitted), key=lambda pair: pair[0])

    def floors(self, best: Adjustment) -> list[tuple[float, Pose]]:
        """Poses of the board at the origin, the best first, with twice the difference of log-likelihoods to it."""
        several = self.boards(best.cameras, self.origin, best.boards[self.origin])
        return [(2.0 * (cost - several[0][0]) / best.noise**2, pose) for cost, pose in several]


def _unsure(best: Adjustment, origin: int) -> list[str]:
    """Notes on poses that the noise of the corners leaves unsure."""
    notes = []
    for name, pose in list(best.cameras.items())[1:]:
        covariance = best.covariances[name]
        turn = float(np.degrees(np.sqrt(np.trace(covariance[:3, :3]))))
        centre = np.hstack([np.cross(np.eye(3), pose[1]), np.eye(3)])
        shift = float(np.sqrt(np.trace(centre @ covariance @ centre.T)))
        distance = float(np.linalg.norm(pose[1]))
        if turn > UNSURE_TURN or shift > UNSURE_SHIFT * distance:
            notes.append(f"the place of {name} is uncertain by {turn:.1f} degrees and {100.0 * shift:.0f} cm: {FILM}")
    turn = float(np.degrees(np.sqrt(np.trace(best.covariances[origin][:3, :3]))))
    if turn > UNSURE_TURN:
        notes.append(
            f"the tilt of the floor is uncertain by {turn:.1f} degrees: bring the board of picture {origin} nearer"
        )
    return notes


def candidates(fit: LensFit, corners: int) -> dict[int, list[BoardPose]]:
    """The poses of the board by frame without those that the view alone rules out; corners: of the board."""
    noise = max(_LEAST_NOISE, fit.rms) / np.sqrt(2.0)
    worse = _CLEAR * noise**2 / corners
    return {frame: [p for p in poses if p.error**2 - poses[0].error ** 2 < worse] for frame, poses in fit.poses.items()}


def placements(a: Mapping[int, list[BoardPose]], b: Mapping[int, list[BoardPose]]) -> list[tuple[Pose, float]]:
    """Camera a from camera b, and how many frames support it: the most supported first, then others that differ.

    a, b: candidate poses of the board by frame. Each combination of them in a frame makes a placement; a frame supports
    a placement by that of its own which is nearest, from 1 where it is equal down to 0. Empty without a common frame.
    """
    common = sorted(set(a) & set(b))
    made = [(i, chained(in_a[:2], inverse(in_b[:2]))) for i, f in enumerate(common) for in_a in a[f] for in_b in b[f]]
    if not made:
        return []
    frame, R = np.array([i for i, _ in made]), np.stack([pose[0] for _, pose in made])
    t = np.stack([pose[1] for _, pose in made])
    far = np.median([np.linalg.norm(pose.t) for side in (a, b) for f in common for pose in side[f]])
    cosine = 0.5 * (np.einsum("iab,jab->ij", R, R) - 1.0)
    turn = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    apart = (turn / _TURN) ** 2 + (np.linalg.norm(t[:, None] - t, axis=2) / (_SHIFT * far)) ** 2
    nearness = 1.0 / (1.0 + apart)
    first = np.flatnonzero(np.diff(frame, prepend=-1))
    support = np.maximum.reduceat(nearness, first, axis=1).sum(axis=1)
    results: list[tuple[Pose, float]] = []
    open_ = np.ones(len(made), bool)
    while open_.any() and len(results) < _MOST:
        best = int(np.argmax(np.where(open_, support, -1.0)))
        if results and support[best] < _LEAST_SUPPORT * results[0][1]:
            break
        near = np.where(apart[best] < 4.0, nearness[best], 0.0)
        mean = Rotation.from_matrix(R).mean(weights=near).as_matrix()
        results.append(((mean, near @ t / near.sum()), float(support[best])))
        open_ &= apart[best] > 1.0
    return results


def upright(cameras: Mapping[str, Pose]) -> float:
    """The agreement of up in the pictures of cameras, 1 where it is one direction, less where some are upside down."""
    return float(np.linalg.norm(np.mean([pose[0][1] for pose in cameras.values()], axis=0)))


def choose_floor(
    floors: Sequence[tuple[float, Pose]], cameras: Mapping[str, Pose], doubted: float, origin: int
) -> tuple[Pose, list[str]]:
    """The board's pose that makes the world, and a note where a mirrored one fits as well.

    floors: its poses, the best first, with twice the difference of log-likelihoods, in doubt below `doubted`. Of those
    that fit as well the one is taken in which the cameras are the right way up: mirrored, a floor that is seen from
    the side turns them upside down.
    """
    best = floors[0][1]
    close = [pose for worse, pose in floors if worse < doubted]
    if all(angle_between(best, pose) < MIRRORED for pose in close):
        return best, []
    up = np.mean([pose[0].T @ [0.0, -1.0, 0.0] for pose in cameras.values()], axis=0)
    chosen = max(close, key=lambda pose: -up @ pose[0][:, 2])
    chosen = chosen if up @ (best[0] - chosen[0])[:, 2] > UPRIGHT else best
    note = (
        f"the floor is in doubt: the board in picture {origin} fits mirrored as well; taken so that the cameras are the"
        " right way up: lay it nearer to the cameras, or use a larger one"
    )
    return chosen, [note]


def in_world(camera: Camera, pose: Pose, floor: Pose) -> Camera:
    """The camera in the world of the floor's board; pose: the camera from, floor: the board in, the same frame."""
    R, t = chained(chained(pose, floor), (R_WORLD_BOARD.T, np.zeros(3)))
    return replace(camera, R_camera_world=R, t_camera_world=t)


def floor_notes(cameras: Mapping[str, Camera], origin: int) -> list[str]:
    """Notes where the cameras contradict that the board of the world lies on the floor."""
    notes = []
    below = [name for name, camera in cameras.items() if camera.centre_world[2] <= 0.0]
    if below:
        notes.append(
            f"{', '.join(below)} would be below the floor: the board in picture {origin} does not lie on it, or is"
            " mirrored: choose another --origin"
        )
    up = np.mean([camera.R_camera_world.T @ [0.0, -1.0, 0.0] for camera in cameras.values()], axis=0)
    if up[2] < np.cos(np.radians(LEVEL)) * np.linalg.norm(up):
        axis = max(AXES, key=lambda name: AXES[name][1] * up[AXES[name][0]])
        notes.append(
            f"the board in picture {origin} does not lie on the floor if the cameras are held level: they have up along"
            f" {axis}: choose another --origin, or track with --up={axis}"
        )
    return notes
