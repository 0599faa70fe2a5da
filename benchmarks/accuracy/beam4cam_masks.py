"""Masks of the person of beam4cam, for `python -m benchmarks beam4cam --masks`: GrabCut of every picture, begun with
the body of a run that was tracked with keypoints. Check them by eye: narrow slits and fringes of a few pixels
are left."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

import kinemode as km
from benchmarks.accuracy.outline import mesh_mask
from benchmarks.support.common import Data, beam_folder, tell
from estimator.data.media.threads import one_thread
from estimator.vision.cues.background import grab
from humanoid.kinematics.body import points_in_world
from humanoid.shape.surface import surface_of
from kinemode.target import made_folder

SCALE = 0.45  # of the pictures that are cut
CORE, NEAR, REACH, FAR = 11, 4, 22, 36  # px about the body's outline: within it surely the person, beyond it ...
_BODY = 7  # px within the outline: what the cut lost of the body
_PAD, _STEPS, _NODES = 70, 3, 4000
_LEAST = 40  # px of a hole that is one


def main(run: Path, out: Path, *, data: Data = None) -> None:
    """Write OUT/cam01/00000.png and so on, white on the person.

    Parameters
    ----------
    run
        Of the clip, by all cameras with keypoints.
    out
        A folder for the masks.
    """
    tracked = km.open_run(run)
    surface = surface_of(tracked.body, _NODES)
    for camera in tracked.header.cameras:
        folder = made_folder(out / camera.name)
        film = cv2.VideoCapture(str(beam_folder(data) / "videos" / f"{camera.name}.mp4"))
        for frame, q in enumerate(tracked.q):
            picture = film.read()[1]
            places = points_in_world(tracked.body.at(q), surface.joint, surface.local)
            mask = cut_out(picture, mesh_mask(camera, places, surface.faces))
            cv2.imwrite(str(folder / f"{frame:05d}.png"), np.where(mask, np.uint8(255), np.uint8(0)))
        tell(camera.name)


@one_thread()
def cut_out(picture: np.ndarray, body: np.ndarray) -> np.ndarray:
    """The person (H, W) bool in a picture (H, W, 3) uint8, by where the body is about, (H, W) bool."""
    x, y, width, height = cv2.boundingRect(body.astype(np.uint8))
    rows = slice(max(0, y - _PAD), y + height + _PAD)
    columns = slice(max(0, x - _PAD), x + width + _PAD)
    whole = body[rows, columns].astype(np.uint8) * 255
    about = cv2.resize(whole, None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_AREA) > 127
    label = np.full(about.shape, cv2.GC_BGD, np.uint8)
    label[_grown(about, FAR)] = cv2.GC_PR_BGD
    label[_grown(about, NEAR)] = cv2.GC_PR_FGD
    label[_shrunk(about, CORE)] = cv2.GC_FGD
    grab(picture[rows, columns], label, _STEPS)
    cut = _without_specks((label % 2 == 1) & _grown(about, REACH) | _shrunk(about, _BODY), about)
    mask = np.zeros(body.shape, bool)
    size = whole.shape[::-1]
    mask[rows, columns] = cv2.resize(cut.astype(np.uint8) * 255, size, interpolation=cv2.INTER_LINEAR) > 127
    return mask


def _without_specks(cut: np.ndarray, about: np.ndarray) -> np.ndarray:
    """A cut (h, w) bool without what does not hang together with the body, and without holes in that."""
    opened = cv2.morphologyEx(cut.astype(np.uint8), cv2.MORPH_OPEN, _disc(3))
    pieces = cv2.connectedComponents(opened)[1]
    kept = np.isin(pieces, np.unique(pieces[_shrunk(about, _BODY) & (opened > 0)]))
    count, holes, stats, _ = cv2.connectedComponentsWithStats((~kept).astype(np.uint8))
    for k in range(1, count):
        inside = holes == k
        kept |= inside & (stats[k, cv2.CC_STAT_AREA] < _LEAST or about[inside].mean() > 0.8)
    return kept


def _disc(px: float) -> np.ndarray:
    radius = max(1, round(px * SCALE))
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)))


def _grown(mask: np.ndarray, px: float) -> np.ndarray:
    return np.asarray(cv2.dilate(mask.astype(np.uint8), _disc(px)) > 0)


def _shrunk(mask: np.ndarray, px: float) -> np.ndarray:
    return np.asarray(cv2.erode(mask.astype(np.uint8), _disc(px)) > 0)
