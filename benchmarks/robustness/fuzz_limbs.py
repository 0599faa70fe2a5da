"""Small valid files of limb potentials and likelihoods, to be damaged, and their use."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.trackers.loose_limbed.limbs.potentials import SHIPPED, load_potentials
from estimator.trackers.loose_limbed.part_detectors.templates import (
    LimbTemplate,
    LimbTemplates,
    load_templates,
    save_templates,
)
from estimator.vision.eigen_templates import EigenSpace
from estimator.vision.patches import CHANNELS
from humanoid.kinematics.body import Body
from humanoid.limbs.graph import LimbGraph, limb_graph
from humanoid.subject.subject import load_subject

EXAMPLES, COMPONENTS, SIDE = 6, 2, 2


def two_limbs() -> bytes:
    """Potentials of two of the limbs that are shipped, and of one time step."""
    content = json.loads(SHIPPED.read_text(encoding="utf-8"))
    names = [content["spatial"][0][end] for end in ("from", "to")]
    between = [entry for entry in content["spatial"] if {entry["from"], entry["to"]} == set(names)]
    dt = content["temporal"][0]["dt"]
    steps = [entry for entry in content["temporal"] if entry["limb"] in names and entry["dt"] == dt]
    return json.dumps({**content, "limbs": names, "spatial": between, "temporal": steps}).encode()


def templates(folder: Path, cameras: list[Camera]) -> bytes:
    """Templates of two limbs for a rig, of random patches."""
    rng = np.random.default_rng(3)
    depth = len(cameras) * CHANNELS * SIDE**2

    def space() -> EigenSpace:
        basis = np.linalg.qr(rng.normal(size=(depth, COMPONENTS)))[0].T
        return EigenSpace(rng.normal(size=depth), basis, np.array([2.0, 1.0]), 0.5)

    def template(*limbs: str) -> LimbTemplate:
        turns = rng.normal(size=(EXAMPLES, 4))
        return LimbTemplate(
            limbs, 0.3, space(), space(), np.array([1.0, 2.0]), rng.normal(size=(EXAMPLES, COMPONENTS)),
            rng.normal(size=(EXAMPLES, 3)), turns / np.linalg.norm(turns, axis=1, keepdims=True),
        )  # fmt: skip

    made = (template("left_forearm", "right_forearm"), template("head"))
    rig = LimbTemplates(
        names=tuple(c.name for c in cameras),
        centre=np.array([c.centre_world for c in cameras]),
        R_camera_world=np.array([c.R_camera_world for c in cameras]),
        box=np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 2.0]]),
        side=SIDE, contrast=0.1, templates=made,
    )  # fmt: skip
    file = folder / "templates.npz"
    save_templates(rig, file)
    return file.read_bytes()


def use_potentials(path: Path) -> object:
    """Draw samples from each and evaluate their density; those of a whole person are applied to its body."""
    read = load_potentials(path)
    rng = np.random.default_rng(0)
    drawn = [(p, p.sample(rng, 3)) for p in read.spatial.values()]
    densities = [p.log_density(points) for p, points in drawn]
    person = read.of_graph(*_human34(), path) if len(read.limbs) > 2 else read
    return densities, person.steps(1.0 / 30.0)


@cache
def _human34() -> tuple[LimbGraph, Body]:
    body = Body(load_subject("human34"))
    return limb_graph(body), body


def use_templates(path: Path) -> object:
    """Score patches by every template."""
    read = load_templates(path)
    patches = np.ones((3, len(read.names) * CHANNELS * read.side**2))
    return [(t.score(patches, by), t.nearest(patches, 2)) for t in read.templates for by in ("ratio", "residual")]
