"""Time of the surface's image cost for one hypothesis, over its floor: kinematics and one pass over the nodes.

One hypothesis is posed, its view predicted, edges and outline (both ways) assigned, gradient and Hessian summed. The
cues are those of a rendered frame, the hypotheses lie around the true pose.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Annotated

import numpy as np

from benchmarks.support.common import Json, Several, save
from estimator.data.image_cues import ImageCues
from estimator.data.observation import image_extent
from estimator.energy.term import Term
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.render import Renderer
from estimator.synthesis.views import scene_cameras
from estimator.vision.cues.assigned import AssignedPoints
from estimator.vision.cues.edges import EdgeSettings, edge_map
from estimator.vision.cues.flow_field import FlowSettings, flow_field
from estimator.vision.cues.foreground import Background, SilhouetteSettings, foreground_mask, silhouette_of
from estimator.vision.cues.image_likelihood import CameraLikelihood, ImageModel
from estimator.vision.cues.settings import CueSettings, cue_settings
from estimator.vision.view import see_points
from humanoid.kinematics.body import Body, PosedBody
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

TARGET_MS = 1.0
TARGET_NODES = 1000
TARGET_DOUBLING = 2.0
FLOOR, WHOLE, FROZEN = "floor: pose, see every node", "all of them", "pose, sum: assignment kept"
INSTANT, BEFORE = 1.2, 1.2 - 1.0 / 30.0  # s into the authored motion


@dataclass(frozen=True)
class Frame:
    """A rendered frame: cues of each camera, the true pose q (nq,) and that of the frame before."""

    cues: tuple[ImageCues, ...]
    q: np.ndarray
    q_before: np.ndarray


def rendered_frame(body: Body, rng: np.random.Generator, cameras: int = 1) -> Frame:
    """The authored motion in the cluttered room, 640 x 480, with a known background."""
    before, now = authored_motion(body, np.array([BEFORE, INSTANT]))
    renderer = Renderer(body, scene_cameras()[:cameras], rng)
    cues = []
    for k, camera in enumerate(renderer.cameras):
        last, picture = (renderer.frame(body.at(q), k, rng) for q in (before, now))
        plate = renderer.plate(k).astype(np.float32)
        background = Background(plate, np.full_like(plate, 2.0), np.ones(plate.shape[:2], dtype=bool))
        mask = foreground_mask(picture, background, SilhouetteSettings())
        flow = flow_field(last, picture, FlowSettings())
        edges, outline = edge_map(picture, EdgeSettings()), silhouette_of(mask, background.known)
        cues.append(ImageCues(camera, {"edges": edges, "flow": flow, "silhouette": outline}, picture))
    return Frame(tuple(cues), now, before)


def hypotheses(body: Body, q: np.ndarray, count: int, rng: np.random.Generator) -> list[np.ndarray]:
    """Poses about as far from the truth as a search starts."""
    return [body.integrate(q, rng.normal(0.0, 0.05, body.nv)) for _ in range(count)]


class Case:
    """One number of nodes: times for one hypothesis."""

    def __init__(self, body: Body, cues: ImageCues, extent: float, settings: CueSettings) -> None:
        self.body, self.cues = body, cues
        self.likelihood = CameraLikelihood(ImageModel(body, settings), cues, extent)
        self.surface = self.likelihood.model.surface
        count = len(self.surface.joint)
        self._intrinsics, self._distortion, self._R, self._t = cues.camera.arrays
        self._seen = np.empty((count, 3)), np.empty((count, 2)), np.empty(count), np.empty(count), np.empty((count, 2))

    def floor(self, q: np.ndarray) -> None:
        """Kinematics with its Jacobians, and every node's place, pixel and facing."""
        s, (world, pixels, depth, facing, normals) = self.surface, self._seen
        see_points(
            self.body.at(q).placements, s.joint, s.local, s.normal, self._intrinsics, self._distortion, self._R,
            self._t, world, pixels, depth, facing, normals,
        )  # fmt: skip

    def whole(self, q: np.ndarray) -> None:
        """Pose, predict, assign, sum."""
        posed = self.body.at(q)
        (term,) = self.likelihood.assigned(posed)
        self._sum(term, posed)

    def stages(self, q: np.ndarray) -> dict[str, Callable[[], object]]:
        """The parts of one hypothesis, each with its inputs prepared."""
        likelihood, posed = self.likelihood, self.body.at(q)
        prediction = likelihood.predictor.predict(posed)
        contours = prediction.contours
        groups = [match.features for match in likelihood.contours(prediction)]

        def joined() -> AssignedPoints:
            return AssignedPoints(self.body, self.cues.camera, contours.joint, contours.local, groups)

        term = joined()
        return {
            FLOOR: lambda: self.floor(q),
            "pose": lambda: self.body.at(q),
            "predict": lambda: likelihood.predictor.predict(posed),
            **{name: partial(matcher.contours, prediction) for name, matcher in likelihood.matchers.items()},
            "join the groups": joined,
            "sum gradient and Hessian": lambda: self._sum(term, posed),
            "sum with exact curvature": lambda: self._sum(term, posed, exact=True),
            WHOLE: lambda: self.whole(q),
            FROZEN: lambda: self._sum(term, self.body.at(q)),
        }

    def _sum(self, term: Term, posed: PosedBody, exact: bool = False) -> None:
        gradient, hessian = np.zeros(self.body.nv), np.zeros((self.body.nv, self.body.nv))
        term.accumulate(posed, gradient, hessian, exact)


def timed(case: Case, poses: Sequence[np.ndarray], rounds: int) -> dict[str, float]:
    """Milliseconds of each stage: the quickest of `rounds` at each pose, the median over the poses.

    The stages take turns, so that a machine that is busy for a while slows all of them.
    """
    quickest: dict[str, list[float]] = {}
    for q in poses:
        stages = case.stages(q)
        best = dict.fromkeys(stages, np.inf)
        for _ in range(rounds):
            for name, stage in stages.items():
                begin = time.perf_counter()
                stage()
                best[name] = min(best[name], time.perf_counter() - begin)
        for name, seconds in best.items():
            quickest.setdefault(name, []).append(1e3 * seconds)
    return {name: float(np.median(values)) for name, values in quickest.items()}


def main(
    *,
    nodes: Annotated[tuple[int, ...], Several] = (1000, 2000, 4000),
    poses: int = 8,
    rounds: int = 40,
    seed: int = 0,
    json: Json = None,
) -> None:
    """Time cost, gradient and Hessian of human34's surface in one camera.

    Parameters
    ----------
    nodes
        Numbers of surface nodes; each is compared with the one before.
    poses
        Hypotheses around the true pose.
    rounds
        How often each is timed; the quickest counts.
    seed
        Of the scene and the hypotheses.
    """
    rng = np.random.default_rng(seed)
    body = Body(load_subject("human34"))
    frame = rendered_frame(body, rng)
    cues = frame.cues[0]
    points = cues.camera.project(body.landmarks(body.at(frame.q)))
    extent = image_extent(points, np.ones(len(points)))
    around = hypotheses(body, frame.q, poses, rng)
    times: dict[int, dict[str, float]] = {}
    counts: dict[int, int] = {}
    settings = cue_settings()
    for count in nodes:
        case = Case(body, cues, extent, replace(settings, surface=replace(settings.surface, nodes=count)))
        case.whole(frame.q)  # compiles
        counts[count] = len(case.surface.joint)
        times[count] = timed(case, around, rounds)
    show(times, counts)
    save(json, {"measure": "surface", "target_ms": TARGET_MS, "nodes": counts, "ms": times,
                "over_floor": {n: f[WHOLE] / f[FLOOR] for n, f in times.items()}})  # fmt: skip


def show(times: dict[int, dict[str, float]], counts: dict[int, int]) -> None:
    asked = list(times)
    columns = [f"{counts[n]} nodes" for n in asked]
    made = report.table("one hypothesis, one camera, one core, quickest [ms]", "", *columns)
    for name in next(iter(times.values())):
        made.add_row(name, *(f"{times[n][name]:.3f}" for n in asked))
    made.add_section()
    made.add_row("all of them, over the floor", *(f"{times[n][WHOLE] / times[n][FLOOR]:.1f}" for n in asked))
    out = report.console()
    out.print(made)
    for less, more in pairwise(asked):
        ratio, grown = times[more][WHOLE] / times[less][WHOLE], counts[more] / counts[less]
        limit = f", target below {TARGET_DOUBLING:g}" if round(grown, 1) == TARGET_DOUBLING else ""
        out.print(f"{counts[less]} to {counts[more]}: {grown:.2f} times the nodes, {ratio:.2f} times the time{limit}")
    enough = [n for n in asked if counts[n] >= TARGET_NODES]
    if enough:
        out.print(f"{counts[enough[0]]} nodes: {times[enough[0]][WHOLE]:.2f} ms, target at most {TARGET_MS:g} ms")
