"""Colours and the drawing primitives every picture shares.

Colours are RGB; `bgr` turns them round for OpenCV. Left and right are blue and orange of the palette of Okabe and Ito
(Color Universal Design, 2008), which stay apart under every common kind of colour blindness.
"""

from __future__ import annotations

import cv2
import numpy as np

Rgb = tuple[int, int, int]

SIDES: dict[str, Rgb] = {"left": (86, 180, 233), "right": (242, 152, 34), "trunk": (226, 222, 210)}
ON_PAPER: dict[str, Rgb] = {"left": (0, 114, 178), "right": (213, 94, 0), "trunk": (51, 51, 51)}
"""The same on white."""
HYPOTHESIS: Rgb = (186, 160, 214)
GOOD: Rgb = (122, 200, 140)
WARN: Rgb = (240, 196, 84)
BAD: Rgb = (236, 104, 96)
BACKGROUND: Rgb = (34, 38, 46)
PANEL: Rgb = (20, 22, 28)
GRID: Rgb = (72, 80, 94)
TEXT: Rgb = (236, 238, 242)
MUTED: Rgb = (150, 158, 172)
STATUS: dict[str, Rgb] = {"tracked": GOOD, "hard": WARN, "unobserved": WARN, "lost": BAD}

_CIRCLE = np.stack([np.cos(np.arange(16) * np.pi / 8), np.sin(np.arange(16) * np.pi / 8)], axis=1)
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_FONT_HEIGHT = 22.0  # of a capital letter at scale 1 [px]


def bgr(colour: Rgb) -> tuple[int, int, int]:
    """OpenCV's order."""
    return colour[2], colour[1], colour[0]


def hexadecimal(colour: Rgb) -> int:
    """The number three.js takes."""
    return (colour[0] << 16) | (colour[1] << 8) | colour[2]


def web(colour: Rgb) -> str:
    """The colour for pages and plots, "#rrggbb"."""
    return f"#{hexadecimal(colour):06x}"


def plain(width: int, height: int, colour: Rgb = BACKGROUND) -> np.ndarray:
    """An image of one colour, (height, width, 3) uint8 BGR."""
    return np.full((height, width, 3), bgr(colour), dtype=np.uint8)


def text_width(string: str, size: float) -> int:
    """Width of a line of text whose capitals are `size` px high [px]."""
    return int(cv2.getTextSize(string, _FONT, size / _FONT_HEIGHT, 1)[0][0])


def text(image: np.ndarray, string: str, origin: tuple[int, int], size: float, colour: Rgb = TEXT) -> int:
    """Write a line, capitals `size` px high, its baseline starting at origin; returns where it ends [px]."""
    cv2.putText(image, string, origin, _FONT, size / _FONT_HEIGHT, bgr(colour), 1, cv2.LINE_AA)
    return origin[0] + text_width(string, size)


def shade(image: np.ndarray, top: int, bottom: int, strength: float = 0.6) -> None:
    """Darken rows top to bottom in place, so that writing stays legible on any picture."""
    strip = image[max(top, 0) : bottom]
    strip[:] = (strip * (1.0 - strength) + np.array(bgr(PANEL)) * strength).astype(np.uint8)


def tint(image: np.ndarray, mask: np.ndarray, colour: Rgb) -> None:
    """Blend a colour into the image in place, with the strength of mask (H, W) uint8."""
    x, y, w, h = cv2.boundingRect(mask)
    if w == 0:
        return
    part = image[y : y + h, x : x + w]
    alpha = mask[y : y + h, x : x + w, None].astype(np.float32) / 255.0
    part[:] = (part + alpha * (np.array(bgr(colour), dtype=np.float32) - part)).astype(np.uint8)


def dot(image: np.ndarray, centre: np.ndarray, radius: float, colour: Rgb, *, hollow: bool = False) -> None:
    """A small disc with a dark rim, or a ring; nothing where the centre is not finite or far outside."""
    height, width = image.shape[:2]
    if not (np.isfinite(centre).all() and -50 < centre[0] < width + 50 and -50 < centre[1] < height + 50):
        return

    def ring(r: float) -> np.ndarray:
        return np.round((centre + r * _CIRCLE) * 16.0).astype(np.int32)

    if hollow:
        cv2.polylines(image, [ring(radius + 0.8)], True, bgr(PANEL), 2, cv2.LINE_AA, 4)
        cv2.polylines(image, [ring(radius + 0.8)], True, bgr(colour), 1, cv2.LINE_AA, 4)
    else:
        cv2.fillConvexPoly(image, ring(radius + 1.2), bgr(PANEL), cv2.LINE_AA, 4)
        cv2.fillConvexPoly(image, ring(radius), bgr(colour), cv2.LINE_AA, 4)
