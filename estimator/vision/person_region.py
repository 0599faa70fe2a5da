"""The region of a person in a picture, from keypoints alone: with the flesh between landmarks, but no pose."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.media.threads import one_thread
from estimator.vision.resolution import resized_pixels
from humanoid.kinematics.body import Body, points_in_world
from humanoid.shape.surface import surface_of

_AT_JOINT = 0.075  # m: a landmark this close to a joint gives its place
_APART = 0.08  # m: landmarks closer than this do not determine the scale
_NEARLY_ALL = 0.97  # of a part's nodes lie within its width: single ones stand out
_SCALE = 0.8  # quantile of the scales that pairs of landmarks show: those pointing at the camera look short
_FARTHEST, _THICKEST = 1e5, 32767  # px: what can be drawn
_SHIFT = 4  # bits of a pixel's fraction that shapes are drawn with


class FleshPart(NamedTuple):
    """Flesh between joints: its landmarks, and how far it reaches from the lines between them [m]."""

    landmarks: tuple[int, ...]
    width: float


@dataclass(frozen=True)
class Limbs:
    """A body as parts between landmarks.

    parts: every landmark belongs to one or more. ends (L,) [m]: how far flesh extends around and beyond each landmark.
    lengths (L, L) [m]: between the landmarks of a part, NaN for others.
    """

    parts: tuple[FleshPart, ...]
    ends: np.ndarray
    lengths: np.ndarray

    @one_thread()
    def mask(self, pixels: np.ndarray, seen: np.ndarray, size: tuple[int, int], width: float) -> np.ndarray:
        """Mask (H, W) bool of the body in a picture of `size` (width, height), at `width` times its own width.

        pixels (L, 2), seen (L,) bool: of the landmarks. Parts whose common landmark is not seen count as one.
        """
        mask = np.zeros(size[::-1], np.uint8)
        scale = width * self.scale(pixels, seen)
        for landmarks, broad in self._joined(seen):
            points = np.round(np.clip(pixels[landmarks], -_FARTHEST, _FARTHEST) * 2**_SHIFT).astype(np.int32)
            if len(landmarks) > 2:
                cv2.fillConvexPoly(mask, cv2.convexHull(points), 1, shift=_SHIFT)
            thick = min(max(1, round(2.0 * broad * scale)), _THICKEST)
            for i in range(len(landmarks)):
                for j in range(i):
                    cv2.line(mask, points[i].tolist(), points[j].tolist(), 1, thick, shift=_SHIFT)
                radius = min(max(1, round(float(self.ends[landmarks[i]]) * scale * 2**_SHIFT)), _THICKEST)
                cv2.circle(mask, points[i].tolist(), radius, 1, cv2.FILLED, shift=_SHIFT)
        return mask > 0

    def scale(self, pixels: np.ndarray, seen: np.ndarray) -> float:
        """Pixels per metre of a body whose landmarks (L, 2) are seen (L,); 0 where they do not determine it."""
        i, j = np.nonzero(np.tril(self.lengths > _APART) & seen[:, None] & seen)
        if not len(i):
            return 0.0
        return float(np.quantile(np.linalg.norm(pixels[i] - pixels[j], axis=-1) / self.lengths[i, j], _SCALE))

    def _joined(self, seen: np.ndarray) -> Iterable[tuple[list[int], float]]:
        """Seen landmarks and width of every part, parts that meet at one that is not seen as one."""
        groups = [(set(part.landmarks), part.width) for part in self.parts]
        for lost in np.flatnonzero(~seen):
            meeting = [g for g in groups if lost in g[0]]
            groups = [g for g in groups if lost not in g[0]]
            groups.append((set().union(*(g[0] for g in meeting)) - {lost}, max((g[1] for g in meeting), default=0.0)))
        return [(sorted(landmarks), width) for landmarks, width in groups if landmarks]


def limbs_of(body: Body) -> Limbs:
    """The parts of a body: its tree is cut at the joints that landmarks lie on; widths are those of its surface.

    Raises
    ------
    InputError: the body has no surface.
    """
    posed = body.at(body.neutral)
    landmarks, joints = body.landmarks(posed), posed.translations
    top, members = _members(body, landmarks, joints)
    surface = surface_of(body)
    nodes, part_of = points_in_world(posed, surface.joint, surface.local), top[surface.joint]
    lengths = np.full((len(landmarks),) * 2, np.nan)
    parts, ends = [], np.zeros(len(landmarks))
    for joint, of_part in members.items():
        if not of_part:
            continue
        index = np.array(sorted(of_part))
        lengths[np.ix_(index, index)] = np.linalg.norm(landmarks[index, None] - landmarks[index], axis=-1)
        side, width = _widths(nodes[part_of == joint], landmarks[index])
        np.maximum.at(ends, index, side)
        parts.append(FleshPart(tuple(index.tolist()), width))
    return Limbs(tuple(parts), ends, lengths)


def _members(body: Body, landmarks: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, dict[int, set[int]]]:
    """The joint at which the part of every joint begins (J,), and the landmarks of the parts by that joint.

    landmarks (L, 3), joints (J, 3) [m]: where they lie.
    """
    on_joint = np.linalg.norm(landmarks[:, None] - joints, axis=-1) < _AT_JOINT  # (L, joints)
    parents = body.model.parents
    top = np.arange(len(joints))  # the joint at which the part of each joint begins
    for joint in range(1, len(top)):
        parent = int(parents[joint])
        # joints at one place, as the three of a hip, are cut once: above the first
        here = np.linalg.norm(joints[joint] - joints[parent]) < _AT_JOINT and parent > 0
        if here or not on_joint[:, joint].any():
            top[joint] = top[parent]
    members: dict[int, set[int]] = {int(t): set() for t in np.unique(top)}
    for i in range(len(landmarks)):
        members[int(top[body.landmark_joint[i]])].add(i)
    for joint in range(1, len(top)):
        if top[joint] == joint:
            at = set(np.flatnonzero(on_joint[:, joint]).tolist())
            members[joint] |= at
            members[int(top[int(parents[joint])])] |= at
    return top, members


def _widths(nodes: np.ndarray, landmarks: np.ndarray) -> tuple[np.ndarray, float]:
    """Reach of the nodes (N, 3) of a part from its landmarks (M, 3) that they lie beyond, (M,), and from the lines
    between them [m]."""
    i, j = np.tril_indices(len(landmarks))
    start, along = landmarks[i], landmarks[j] - landmarks[i]
    length = np.maximum(np.einsum("ka,ka->k", along, along), 1e-12)
    offset = nodes[:, None] - start
    share = np.einsum("nka,ka->nk", offset, along) / length
    away = np.linalg.norm(offset - np.clip(share, 0.0, 1.0)[..., None] * along, axis=-1)
    nearest = away.argmin(axis=1)
    row = np.arange(len(nodes))
    away, share = away[row, nearest], share[row, nearest]
    end = np.where(share <= 0.0, i[nearest], np.where(share >= 1.0, j[nearest], -1))

    def reach(which: int) -> float:
        return float(np.quantile(away[end == which], _NEARLY_ALL)) if (end == which).any() else 0.0

    return np.array([reach(k) for k in range(len(landmarks))]), reach(-1)


_FEWEST = 3  # keypoints; fewer do not locate a body


@dataclass(frozen=True, eq=False)
class KnownPerson:
    """Where a person is, from the keypoints of one camera.

    limbs: of the body. pixels (T, L, 2) [px], seen (T, L) bool: its landmarks at every instant. image_size: of the
    pictures that the keypoints are of.
    """

    limbs: Limbs
    pixels: np.ndarray
    seen: np.ndarray
    image_size: tuple[int, int]

    @cached_property
    def instants(self) -> np.ndarray:
        """The instants (K,) with enough keypoints."""
        sufficient = [
            seen.sum() >= _FEWEST and self.limbs.scale(pixels, seen) > 0.0
            for pixels, seen in zip(self.pixels, self.seen, strict=True)
        ]
        return np.flatnonzero(sufficient)

    def mask(self, instant: int, size: tuple[int, int], width: float) -> np.ndarray:
        """Mask (H, W) bool of the body in a picture of `size` (width, height), at `width` times its own width."""
        pixels = resized_pixels(self.pixels[instant], self.image_size, size)
        return self.limbs.mask(pixels, self.seen[instant], size, width)


def known_persons(
    body: Body, cameras: Sequence[Camera], pixels: np.ndarray, confidence: np.ndarray
) -> list[KnownPerson]:
    """Where the person is by the keypoints, for every camera.

    body: of any proportions; only the widths of its parts beside their lengths count. pixels (T, C, L, 2) [px],
    confidence (T, C, L): of its landmarks, 0 where they are missing.

    Raises
    ------
    InputError: the body has no surface.
    """
    limbs = limbs_of(body)
    return [
        KnownPerson(limbs, pixels[:, c], confidence[:, c] > 0.0, camera.image_size) for c, camera in enumerate(cameras)
    ]
