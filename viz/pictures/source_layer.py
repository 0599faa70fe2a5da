"""The source that a body follows, drawn beside it: the floor under both, what is to stand on it, a stick figure, and
names."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from humanoid.kinematics.body import Body
from viz import palette
from viz.pictures.painter import ImageProjection
from viz.solids.solid import side_of
from viz.source_figure import HEAD_RADIUS, SourceFigure

_RADIUS = 0.05  # of the disc under a point that stands [m]
_NEAR = 0.05  # what is closer to the eye than this is not drawn [m]
_FARTHEST = 8000.0  # px, beyond which OpenCV's coordinates end
_SIZE = 10.0  # height of capitals [px]
_BELOW = 3.0  # capitals that a name is below its place
_CAPTION = 3.4  # capitals from the lower border that the caption takes
_ROUND = np.stack([np.cos(np.arange(24) * np.pi / 12), np.sin(np.arange(24) * np.pi / 12), np.zeros(24)], axis=1)


@dataclass(frozen=True)
class SourceLayer:
    """Draw a source into one picture, an image (H, W, 3) uint8 that changes in place, of instant t, in which the body
    has the configuration q (nq,), NaN for none."""

    body: Body
    source: SourceFigure
    view: ImageProjection
    t: int
    q: np.ndarray

    def draw_floor(self, canvas: np.ndarray) -> None:
        """Its lines, and discs on it: where the source's soles stand, and where those of the body are to."""
        source, t = self.source, self.t
        for ends in source.floor_lines:
            _line(canvas, self.view, ends, palette.GRID, 1)
        self._draw_discs(canvas, source.standing_points(t, source.names, source.points[t]))
        if np.isfinite(self.q).all():
            body = self.body
            landmarks = body.landmarks(body.at(self.q))
            self._draw_discs(canvas, source.standing_points(t, body.landmark_names, landmarks))

    def draw_figure(self, canvas: np.ndarray) -> None:
        """Bones, joints and a head."""
        source, points = self.source, self.source.points[self.t]
        thickness = max(2, round(max(self.view.size) / 240))
        for (i, k), side in zip(source.segments, source.sides, strict=True):
            _line(canvas, self.view, points[[i, k]], palette.SIDES[side], thickness)
        pixels, _ = self.view.project(points)
        for name, pixel in zip(source.names, pixels, strict=True):
            palette.dot(canvas, pixel, 0.7 * thickness, palette.SIDES[side_of(name)])
        self._draw_head(canvas, thickness)

    def draw_names(self, canvas: np.ndarray) -> None:
        """Labels of source and subject, on the floor below both."""
        for said, place in (("source", self.source.place(self.t)), ("subject", self._place())):
            pixel, depth = self.view.project(np.array([*place[:2], self.source.level]))
            if _drawable(pixel, depth):
                left = round(float(pixel[0]) - palette.text_width(said, _SIZE) / 2.0)
                low = min(float(pixel[1]) + _BELOW * _SIZE, self.view.size[1] - _CAPTION * _SIZE)
                palette.text(canvas, said, (left, round(low)), _SIZE)

    @property
    def in_front(self) -> bool:
        """Whether the figure is nearer to the eye than the body is."""
        _, depth = self.view.project(np.array([self.source.place(self.t), self._place()]))
        return bool(depth[0] < depth[1])

    def _place(self) -> np.ndarray:
        """Place of the body's root, or first joint [m], (3,)."""
        return self.body.at(self.q).translations[1] if np.isfinite(self.q).all() else np.full(3, np.nan)

    def _draw_discs(self, canvas: np.ndarray, points: np.ndarray) -> None:
        """Under points (N, 3) [m], on the floor: what floats is above its disc."""
        for point in points:
            rim = np.array([*point[:2], self.source.level]) + _RADIUS * _ROUND
            pixels, depth = self.view.project(rim)
            if _drawable(pixels, depth):
                cv2.fillConvexPoly(canvas, _fixed(pixels), palette.bgr(palette.GOOD), cv2.LINE_AA, 4)

    def _draw_head(self, canvas: np.ndarray, thickness: int) -> None:
        if self.source.head is None:
            return
        centre = self.source.points[self.t, self.source.head]
        pixels, depth = self.view.project(np.array([centre, centre + HEAD_RADIUS * self.view.axes()[0]]))
        if _drawable(pixels, depth):
            x, y = _fixed(pixels[0]).tolist()
            radius = round(16.0 * float(np.linalg.norm(pixels[1] - pixels[0])))
            cv2.circle(canvas, (x, y), radius, palette.bgr(palette.SIDES["trunk"]), thickness, cv2.LINE_AA, 4)


def _line(canvas: np.ndarray, view: ImageProjection, ends: np.ndarray, colour: palette.Rgb, thickness: int) -> None:
    pixels, depth = view.project(ends)
    if _drawable(pixels, depth):
        first, second = _fixed(pixels).tolist()
        cv2.line(canvas, first, second, palette.bgr(colour), thickness, cv2.LINE_AA, 4)


def _drawable(pixels: np.ndarray, depth: np.ndarray) -> bool:
    return bool(np.isfinite(pixels).all() and np.min(depth) > _NEAR and np.abs(pixels).max() < _FARTHEST)


def _fixed(pixels: np.ndarray) -> np.ndarray:
    """In sixteenths of a pixel, as OpenCV takes them."""
    return np.asarray(np.round(pixels * 16.0).astype(np.int32))
