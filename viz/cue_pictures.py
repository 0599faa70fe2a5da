"""The image evidence of a camera for a pose: cues, the features assigned to the body, keypoints, visibility."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from estimator.data.media.picture import write_picture
from estimator.vision.cues.cue_picture import Area, Colour, CuePicture, Dots, PixelLines, dimmed
from estimator.vision.prediction import Prediction
from estimator.vision.visibility import BACK_FACING, OCCLUDED, OUTSIDE, VISIBLE
from humanoid.support.errors import InputError
from viz import palette
from viz.solids.body_solids import side_of

LONGEST = 1000  # longer side of the part of the picture that is shown [px]
_HEADER = 30
_NARROWEST = 0.7  # shorter over longer side of what is shown, so that the header fits
_SHIFT = 4  # binary places of OpenCV's fixed-point coordinates
_BLUE: palette.Rgb = palette.SIDES["left"]
_ORANGE: palette.Rgb = palette.SIDES["right"]
_NODES = {
    VISIBLE: ("front", palette.GOOD),
    BACK_FACING: ("back", _BLUE),
    OCCLUDED: ("hidden by another part", palette.BAD),
    OUTSIDE: ("not in the picture", palette.MUTED),
}
Legend = Sequence[tuple[str, palette.Rgb]]
_COLOURS: dict[Colour, palette.Rgb] = {
    "good": palette.GOOD,
    "warn": palette.WARN,
    "bad": palette.BAD,
    "muted": palette.MUTED,
    "text": palette.TEXT,
    "hypothesis": palette.HYPOTHESIS,
    "left": _BLUE,
    "right": _ORANGE,
}


@dataclass(frozen=True)
class CueView:
    """One camera at one instant, with a pose; all pixels are of `image`.

    camera: its name. image (H, W, 3) uint8 BGR. names (L): of the landmarks. keypoints (L, 2), NaN where missing;
    landmarks (L, 2): of the pose.
    prediction: what the image should show of the pose, None where only keypoints were used. pictures: the cues'
    evidence for it.
    """

    camera: str
    image: np.ndarray
    names: tuple[str, ...]
    keypoints: np.ndarray
    landmarks: np.ndarray
    prediction: Prediction | None = None
    pictures: tuple[CuePicture, ...] = ()


def write_cue_pictures(views: Sequence[CueView], folder: str | Path) -> list[Path]:
    """Write PNGs for every camera, `CAMERA_edges.png` and so on, of what is available; the folder is made if needed.

    Raises
    ------
    InputError: the folder cannot be made or written to.
    """
    folder, written = Path(folder), []
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, f"cannot be made: {error.strerror}", remedy="name a folder of your own") from None
    for view in views:
        for name, picture in cue_pictures(view):
            path = folder / f"{view.camera}_{name}.png".replace("/", "_")
            written.append(write_picture(path, picture))
    return written


def cue_pictures(view: CueView) -> Iterator[tuple[str, np.ndarray]]:
    """Name and picture (H, W, 3) uint8 BGR of everything there is to show in a view."""
    yield "keypoints", _keypoints(view)
    if view.prediction is not None:
        yield "visibility", _visibility(view, view.prediction)
    for picture in view.pictures:
        yield picture.name, _drawn(view, picture)


class _Sheet:
    """The part of a picture around the body, enlarged, with a header that explains the colours."""

    def __init__(self, view: CueView, background: np.ndarray, title: str, legend: Legend) -> None:
        corner, size, self._zoom = _window(view)
        self._corner = corner
        part = background[corner[1] : corner[1] + size[1], corner[0] : corner[0] + size[0]]
        part = part if part.ndim == 3 else cv2.cvtColor(part, cv2.COLOR_GRAY2BGR)
        shown = (round(size[0] * self._zoom), round(size[1] * self._zoom))
        self.image = np.ascontiguousarray(cv2.resize(part, shown, interpolation=cv2.INTER_LINEAR))
        self._title, self._legend = f"{view.camera}: {title}", legend

    def at(self, pixels: np.ndarray) -> np.ndarray:
        """Pixels (..., 2) of the view's image on the sheet."""
        return (pixels - self._corner + 0.5) * self._zoom - 0.5

    def dots(self, pixels: np.ndarray, colour: palette.Rgb, radius: float = 2.0) -> None:
        """Small discs at pixels (N, 2)."""
        for centre in _fixed(self.at(pixels)):
            cv2.circle(self.image, centre, round(radius * (1 << _SHIFT)), palette.bgr(colour), -1, cv2.LINE_AA, _SHIFT)

    def lines(self, start: np.ndarray, end: np.ndarray, colour: palette.Rgb, weight: np.ndarray | None = None) -> None:
        """Lines between pixels (N, 2), fainter where weight (N,), 0 to 1, is small."""
        mask = np.zeros(self.image.shape[:2], np.uint8)
        strength = np.ones(len(start)) if weight is None else 0.15 + 0.85 * weight
        for a, b, s in zip(_fixed(self.at(start)), _fixed(self.at(end)), strength.tolist(), strict=True):
            cv2.line(mask, a, b, round(255 * s), 1, cv2.LINE_AA, _SHIFT)
        palette.tint(self.image, mask, colour)

    def finished(self) -> np.ndarray:
        """The picture under its header."""
        header = palette.plain(max(self.image.shape[1], self._header_width()), _HEADER, palette.PANEL)
        x = palette.text(header, self._title, (8, 20), 11.0)
        for name, colour in self._legend:
            x = palette.text(header, name, (x + 16, 20), 10.0, colour)
        below = palette.plain(header.shape[1], self.image.shape[0], palette.PANEL)
        below[:, : self.image.shape[1]] = self.image
        return np.concatenate([header, below], axis=0)

    def _header_width(self) -> int:
        words = sum(16 + palette.text_width(name, 10.0) for name, _ in self._legend)
        return 16 + palette.text_width(self._title, 11.0) + words


def _window(view: CueView) -> tuple[np.ndarray, np.ndarray, float]:
    """Corner and size (2,) [px] of the part of the image around the body, and its magnification."""
    limits = np.array(view.image.shape[1::-1])
    points = view.landmarks if view.prediction is None else view.prediction.pixels
    points = np.concatenate([points, view.keypoints])
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0:
        return np.zeros(2, int), limits, LONGEST / limits.max()
    centre, extent = 0.5 * (points.min(axis=0) + points.max(axis=0)), np.ptp(points, axis=0)
    half = 0.5 * np.maximum(extent, _NARROWEST * extent.max()) + 0.12 * extent.max() + 8.0
    low, high = (np.clip(p, 0, limits).round().astype(int) for p in (centre - half, centre + half))
    if (high - low < 16).any():  # the body is not in the picture
        low, high = np.zeros(2, int), limits
    return low, high - low, LONGEST / float((high - low).max())


def _fixed(pixels: np.ndarray) -> list[tuple[int, int]]:
    """Pixels (N, 2) as OpenCV's fixed-point numbers; those far out of any picture are kept where it can count."""
    safe = np.clip(np.nan_to_num(pixels, nan=-1e4), -1e4, 1e4)
    return [(int(x), int(y)) for x, y in np.round(safe * (1 << _SHIFT))]


def _keypoints(view: CueView) -> np.ndarray:
    legend = [
        ("keypoint, left", _BLUE),
        ("right", _ORANGE),
        ("middle", palette.SIDES["trunk"]),
        ("to the body's landmark", palette.BAD),
    ]
    sheet = _Sheet(view, (view.image * 0.6).astype(np.uint8), "keypoints", legend)
    seen = np.isfinite(view.keypoints).all(axis=1)
    sheet.lines(view.keypoints[seen], view.landmarks[seen], palette.BAD)
    for name, landmark, keypoint in zip(view.names, sheet.at(view.landmarks), sheet.at(view.keypoints), strict=True):
        palette.dot(sheet.image, landmark, 3.0, palette.SIDES[side_of(name)], hollow=True)
        palette.dot(sheet.image, keypoint, 2.5, palette.SIDES[side_of(name)])
    return sheet.finished()


def _visibility(view: CueView, prediction: Prediction) -> np.ndarray:
    sheet = _Sheet(view, dimmed(view.image), "nodes of the surface", list(_NODES.values()))
    for state in (OUTSIDE, BACK_FACING, OCCLUDED, VISIBLE):
        radius = 1.6 if state == BACK_FACING else 2.4
        sheet.dots(prediction.pixels[prediction.state == state], _NODES[state][1], radius)
    return sheet.finished()


def _drawn(view: CueView, picture: CuePicture) -> np.ndarray:
    """A cue's evidence, in the colours of the palette."""
    base = picture.base
    for layer in picture.layers:
        if isinstance(layer, Area):
            base = base.copy() if base.ndim == 3 else cv2.cvtColor(base, cv2.COLOR_GRAY2BGR)
            palette.tint(base, layer.strength, _COLOURS[layer.colour])
    sheet = _Sheet(view, base, picture.title, [(text, _COLOURS[colour]) for text, colour in picture.legend])
    for layer in picture.layers:
        if isinstance(layer, PixelLines):
            sheet.lines(layer.start, layer.end, _COLOURS[layer.colour], layer.weight)
        elif isinstance(layer, Dots):
            sheet.dots(layer.at, _COLOURS[layer.colour], layer.radius)
    return sheet.finished()
