"""Diagnostic image of a lookup: the features that a picture was looked up by, and the examples found."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from estimator.data.image_cues import ImageCues
from estimator.search.examples.lookup import Lookup
from estimator.search.jumps.anatomy import Anatomy
from estimator.vision.cues.cue_picture import CuePicture, Dots, PixelLines, dimmed
from estimator.vision.edge_histogram import edges_by_direction
from estimator.vision.person_view import square_transform
from humanoid.kinematics.body import Body

NAME = "examples"


def lookup_picture(
    body: Body, anatomy: Anatomy, side: float, cues: ImageCues, lookup: Lookup, modes: Sequence[np.ndarray]
) -> CuePicture:
    """The edges that a person was looked up by, the limbs of the examples, the nearest the strongest, and those of the
    modes that were reached, the likeliest the strongest.

    side [m]: of the square that was cut out. modes (K) of (nq,).
    """
    to_square = square_transform(cues.camera, lookup.frame, side)
    rows, columns = np.nonzero(np.any(edges_by_direction(lookup.square, lookup.where), axis=0))
    edges = (np.stack([columns, rows], axis=1) - to_square[:, 2]) / to_square[0, 0]
    return CuePicture(
        NAME,
        "edges, examples and modes",
        cv2.cvtColor(dimmed(cues.picture), cv2.COLOR_GRAY2BGR),
        [
            Dots(edges, "text", 0.7),
            _limbs(body, anatomy, cues, list(lookup.q), "hypothesis"),
            _limbs(body, anatomy, cues, modes, "good"),
        ],
        [("edges looked up", "text"), ("examples", "hypothesis"), ("modes", "good")],
    )


def _limbs(body: Body, anatomy: Anatomy, cues: ImageCues, poses: Sequence[np.ndarray], colour: str) -> PixelLines:
    """Both segments of every limb of some poses, fainter from one to the next."""
    ends, weight = [], []
    for k, q in enumerate(poses):
        pixels = cues.camera.project(body.landmarks(body.at(q)))
        for limb in anatomy.limbs:
            root, middle, end = pixels[limb.landmarks]
            ends += [(root, middle), (middle, end)]
            weight += [1.0 / (1.0 + k)] * 2
    seen = np.array(ends).reshape(-1, 2, 2)
    inside = np.isfinite(seen).all(axis=(1, 2))
    return PixelLines(seen[inside, 0], seen[inside, 1], colour, np.array(weight)[inside])
