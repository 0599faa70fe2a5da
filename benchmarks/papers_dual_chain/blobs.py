"""Hands found as blobs of skin, by a colour learned in the first frame alone.

    python -m benchmarks blobs [--seeds 0 1 2 3 4] [--jobs 2] [--pictures FOLDER] [--json FILE]

The three motions of upper13 before a parallel camera, in long sleeves, with boards in the colour of skin on the wall
and one that swings behind the person; clothes, boards and noise of each seed. Skin is learned at the first frame's
keypoints, as a detector gives them: face, and hands beyond the wrists.

A hand is visible where the renderer's map of parts shows half of its outline or more, and apart where it is farther
than 3 px from all other skin. It is found where the middle of a blob is within 8 px of its own, in the image of the
truth. A false blob is on no skin of the person's, or the second on one piece of it. Bars, with a picture of the empty
scene and boards that stand still: of the hands that are apart 95 % found, 0.1 false blobs a frame.
"""

from __future__ import annotations

import tempfile
from collections import defaultdict
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import cv2
import numpy as np
from cyclopts import Parameter

import kinemode as km
from benchmarks.support.common import Json, Several, check_known, in_processes, save, tell
from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras import load_cameras
from estimator.data.formats.keypoints import load_keypoints
from estimator.data.image_cues import ImageCues
from estimator.data.media.picture import write_picture
from estimator.data.observation import image_extent
from estimator.synthesis.render import Renderer
from estimator.trackers.dual_chain.faces import skin_points
from estimator.trackers.dual_chain.skin import Blobs, SkinModel, SkinSettings, learned_skin, skin_blobs
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from humanoid.kinematics.body import Body, points_in_world
from humanoid.shape.surface import Surface, surface_of
from humanoid.subject.subject import load_subject
from kinemode.shot import RenderedClip
from kinemode.target import made_folder
from kinemode.terminal import report

MOTIONS = ("reach_out", "cross_arms", "talk")
HANDS, OTHER_SKIN = ("left_hand", "right_hand"), ("head", "neck")
BOARDS = 5
NEAR = 8.0  # px from a hand to the blob that is it
APART = 3  # px
VISIBLE = 0.5
SHOWN = 8  # pictures of a clip that are kept
SCENES = {"still boards": 0, "a swinging board": 1}
FOREGROUND = {"empty scene given": True, "learned from the clip": True, "none": False}


class Case(NamedTuple):
    """One clip: a motion and a seed, before one of `SCENES`; ways of `FOREGROUND`; where pictures are kept."""

    motion: str
    seed: int
    scene: str
    ways: tuple[str, ...]
    fps: float
    pictures: Path | None


@dataclass
class Score:
    """Hands by where they are ("apart", "touching"): distances [px] to the nearest blob, and to it from the middle of
    what is visible of the hand; whether that blob is marked as merged. false, frames: counts."""

    distance: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    from_seen: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    merged: dict[str, list[bool]] = field(default_factory=lambda: defaultdict(list))
    false: int = 0
    frames: int = 0


class Truth(NamedTuple):
    """One frame's. skin (H, W) int: numbers of the connected pieces of the person's skin. middles (2, 2) [px], areas
    (2,) [px^2]: of the hands if nothing were before them. seen: masks (H, W) of what is visible of them. apart (2,)."""

    skin: np.ndarray
    middles: np.ndarray
    areas: np.ndarray
    seen: list[np.ndarray]
    apart: list[bool]


def main(
    *,
    seeds: Annotated[tuple[int, ...], Several] = (0, 1, 2, 3, 4),
    motions: Annotated[tuple[str, ...], Several] = MOTIONS,
    scenes: Annotated[tuple[str, ...], Several] = tuple(SCENES),
    ways: Annotated[tuple[str, ...], Several] = tuple(FOREGROUND),
    fps: float = 25.0,
    jobs: int = 1,
    pictures: Annotated[Path | None, Parameter(help="Folder for some pictures with blobs drawn on them.")] = None,
    json: Json = None,
) -> None:
    """Render, learn, find.

    Parameters
    ----------
    seeds
        Of clothes, boards, noise and keypoints.
    motions
        The motions of the clips.
    scenes
        What is behind the person.
    ways
        What is known of where the person can be.
    fps
        Frames per second of the clips.
    jobs
        So many clips at a time.
    """
    for option, names, known in (
        ("--motions", motions, MOTIONS),
        ("--scenes", scenes, SCENES),
        ("--ways", ways, FOREGROUND),
    ):
        check_known(option, names, known)
    cases = [Case(motion, seed, scene, ways, fps, pictures) for scene in scenes for motion in motions for seed in seeds]
    scores = dict(zip(cases, in_processes(scored, cases, jobs), strict=True))
    table = report.table(
        "hands within 8 px of a blob", "behind", "foreground", "clip", "apart", "worst seed", "touching", "all visible",
        "median", "of touching marked", "false a frame",
    )  # fmt: skip
    rows = []
    for scene in scenes:
        for way in ways:
            for motion in (*motions, "all"):
                mine = [s[way] for c, s in scores.items() if c.scene == scene and motion in (c.motion, "all")]
                rows.append({"scene": scene, "foreground": way, "clip": motion, **summary(mine)})
                table.add_row(scene, way, motion, *texts(rows[-1]))
    report.console().print(table)
    save(json, {"measure": "blobs", "seeds": seeds, "rows": rows})


def summary(scores: list[Score]) -> dict[str, Any]:
    """Figures of several clips together; "worst": of one clip."""
    kinds = {"apart": ("apart",), "touching": ("touching",), "visible": ("apart", "touching")}
    pooled = {k: np.array([d for s in scores for kind in kinds[k] for d in s.distance[kind]]) for k in kinds}
    seen = np.array([d for s in scores for d in s.from_seen["apart"]])
    marked = [m for s in scores for m in s.merged["touching"]]
    return {
        "hands": {k: len(d) for k, d in pooled.items()},
        "found": {k: _share(d) for k, d in pooled.items()},
        "worst": min((_share(np.array(s.distance["apart"])) for s in scores), default=np.nan),
        "found_from_seen": _share(seen),
        "median": float(np.median(pooled["apart"])) if len(pooled["apart"]) else np.nan,
        "marked": float(np.mean(marked)) if marked else np.nan,
        "false": sum(s.false for s in scores) / max(1, sum(s.frames for s in scores)),
    }


def _share(distances: np.ndarray) -> float:
    return float(np.mean(distances <= NEAR)) if len(distances) else np.nan


def texts(row: dict[str, Any]) -> list[str]:
    """The figures of a row."""
    shares = [row["found"]["apart"], row["worst"], row["found"]["touching"], row["found"]["visible"]]
    return [
        *(f"{share:.1%}" for share in shares), f"{row['median']:.1f} px", f"{row['marked']:.0%}", f"{row['false']:.3f}"
    ]  # fmt: skip


def scored(case: Case) -> dict[str, Score]:
    """The scores of one clip, by what is known of the foreground."""
    tell(f"{case.motion}, {case.scene}, seed {case.seed}")
    with tempfile.TemporaryDirectory(prefix="kinemode-blobs-") as folder:
        scene = km.SceneSettings(sleeves="long", boards=BOARDS, swinging=SCENES[case.scene])
        clip = km.render(
            Path(folder), case.motion, fps=case.fps, seed=case.seed, scene=scene, view=km.ViewSettings(parallel=True)
        )
        (camera,) = load_cameras(clip.cameras).values()
        q = np.load(clip.truth, allow_pickle=False)["q"]
        true = truths(camera, q)
        return {way: _found(case, clip, camera, true, way) for way in case.ways}


def _found(case: Case, clip: RenderedClip, camera: Camera, true: list[Truth], way: str) -> Score:
    (name,) = clip.videos
    plates = [clip.plates[name]] if way == "empty scene given" else None
    cues = cue_settings(("silhouette",))
    score, model = Score(), None
    with closing(CueReader([clip.videos[name]], [camera], cues, plates=plates)) as reader:
        for t, frame in enumerate(true):
            seen = reader.at(t)[0]
            mask = seen["silhouette"].mask if FOREGROUND[way] else None
            picture = _picture(seen)
            model = model or _learned(clip.keypoints[name], picture, mask)
            blobs = skin_blobs(picture, model, mask, SkinSettings())
            _count(score, frame, blobs)
            if case.pictures is not None and t % max(1, len(true) // SHOWN) == 0:
                folder = made_folder(case.pictures / f"{case.motion}_{case.scene}_{case.seed}_{way}".replace(" ", "_"))
                write_picture(folder / f"{t:05d}.png", draw_blobs(picture, blobs))
    return score


def _picture(seen: ImageCues) -> np.ndarray:
    assert seen.picture is not None
    return seen.picture


def _learned(keypoints: Path, picture: np.ndarray, mask: np.ndarray | None) -> SkinModel:
    """From the first frame's keypoints."""
    track = load_keypoints(keypoints)
    pixels = track.pixels[0]
    points, faces = skin_points(track.names, pixels)
    extent = image_extent(pixels, track.confidence[0])
    return learned_skin(picture, points, faces, extent, SkinSettings(), str(keypoints), mask)


def truths(camera: Camera, q: np.ndarray) -> list[Truth]:
    """The truth of every frame of q (T, nq), by the renderer's own map of parts."""
    body = Body(load_subject("upper13"))
    renderer = Renderer(body, [camera], np.random.default_rng(0), km.SceneSettings(background="black"))
    surface = surface_of(body, nodes=3000)
    return [_truth(renderer, body, surface, pose) for pose in q]


def _truth(renderer: Renderer, body: Body, surface: Surface, q: np.ndarray) -> Truth:
    posed = body.at(q)
    part = renderer.maps(posed, 0).part
    index = {link: k for k, link in enumerate(renderer.parts)}
    skin = np.isin(part, [index[link] for link in (*HANDS, *OTHER_SKIN)])
    _, pieces = cv2.connectedComponents(skin.astype(np.uint8), connectivity=8)
    pixels = renderer.cameras[0].project(points_in_world(posed, surface.joint, surface.local))
    middles, areas, seen, apart = [], [], [], []
    for hand in HANDS:
        outline = cv2.convexHull(pixels[surface.part == surface.links.index(hand)].astype(np.float32))
        moments = cv2.moments(outline)
        middles.append([moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]])
        areas.append(moments["m00"])
        seen.append(part == index[hand])
        wider = cv2.dilate(seen[-1].astype(np.uint8), np.ones((2 * APART + 1,) * 2, np.uint8)) > 0
        apart.append(not (wider & skin & ~seen[-1]).any())
    return Truth(pieces, np.array(middles), np.array(areas), seen, apart)


def _count(score: Score, true: Truth, blobs: Blobs) -> None:
    """Add the figures of one frame."""
    for hand in range(len(HANDS)):
        if true.seen[hand].sum() < VISIBLE * true.areas[hand]:
            continue
        kind = "apart" if true.apart[hand] else "touching"
        off = np.linalg.norm(blobs.mean - true.middles[hand], axis=1)
        y, x = np.nonzero(true.seen[hand])
        from_seen = np.linalg.norm(blobs.mean - [x.mean(), y.mean()], axis=1)
        score.distance[kind].append(float(off.min()) if len(off) else np.inf)
        score.from_seen[kind].append(float(from_seen.min()) if len(off) else np.inf)
        score.merged[kind].append(bool(len(off) and blobs.merged[off.argmin()]))
    score.frames += 1
    away, nearest = cv2.distanceTransformWithLabels(
        (true.skin == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_CCOMP
    )
    x, y = np.round(blobs.mean).astype(int).T
    on_skin = away[y, x] <= NEAR
    pieces = nearest[y, x][on_skin]
    score.false += int((~on_skin).sum()) + len(pieces) - len(set(pieces.tolist()))


def draw_blobs(picture: np.ndarray, blobs: Blobs) -> np.ndarray:
    """A picture with an ellipse of two standard deviations about each blob, red ones merged."""
    image = picture.copy()
    for mean, covariance, merged in zip(blobs.mean, blobs.covariance, blobs.merged, strict=True):
        squares, axes = np.linalg.eigh(covariance)
        angle = float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
        size = 2.0 * np.sqrt(squares[::-1])
        cv2.ellipse(
            image, np.round(mean).astype(int).tolist(), np.round(size).astype(int).tolist(), angle, 0.0, 360.0,
            (0, 0, 255) if merged else (0, 255, 255), 2, cv2.LINE_AA,
        )  # fmt: skip
    return image
