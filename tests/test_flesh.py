"""Flesh as wide as a person, solids slimmer: girths, and distances that ignore the flesh."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from trimesh import Trimesh

from humanoid.kinematics.body import Body
from humanoid.shape.flesh import solid_mesh
from humanoid.shape.solids import ConvexSolid, solids_of
from humanoid.subject.subject import Subject, load_subject, subject_from_text


def slim(subject: Subject) -> Subject:
    """The subject with flesh as thick as its solids."""
    text, count = re.subn(r'radii="[^"]*"(.*?) clearance="([\d. ]+)"', r'radii="\2"\1', subject.urdf)
    assert count > 5 or subject.name == "arm8"
    return subject_from_text(text, source="slim.urdf", base=subject.base)


def exact(solid: ConvexSolid) -> list[bytes]:
    size = [getattr(solid.geometry, k, 0.0) for k in ("radius", "halfLength")]
    return [np.asarray(a).tobytes() for a in (size, solid.radii, solid.rotation, solid.translation, solid.core_half)]


@pytest.mark.parametrize("name", ["human34", "arm8", "upper13"])
def test_solids_do_not_know_the_flesh_to_the_bit(name: str) -> None:
    """Flesh may be as wide as a person: distances are those of the solids, also after lengths were fitted."""
    rng = np.random.default_rng(0)
    subject = load_subject(name)
    scales = {p.joint: float(rng.uniform(0.85, 1.15)) for p in subject.proportions}
    again = {p.joint: float(rng.uniform(0.99, 1.01)) for p in subject.proportions}
    thin = slim(subject)
    for wide, narrow in (
        (subject, thin),
        (subject.scaled(scales), thin.scaled(scales)),
        (subject.scaled(scales).scaled(again), thin.scaled(scales).scaled(again)),
    ):
        ours, theirs = (solids_of(Body(s)) for s in (wide, narrow))
        assert [exact(s) for s in ours] == [exact(s) for s in theirs]
        assert max(f.size[0] / f.core.size[0] for f in wide.flesh) > 1.15
        for flesh in wide.flesh:
            assert min(flesh.size[:2]) >= min(flesh.core.size[:2])


def test_a_solid_keeps_its_proportion_to_the_flesh() -> None:
    subject = load_subject("human34")
    k = [f.link for f in subject.flesh].index("left_thigh")
    thigh = subject.flesh[k]
    assert thigh.core.size == (0.072, 0.068, 0.24)
    thicker = subject.reshaped({k: thigh.parameters * [1.2, 1.1, 1, 1, 1, 1, 1, 1, 1]})
    assert thicker.flesh[k].core.size == pytest.approx((0.072 * 1.2, 0.068 * 1.1, 0.24))
    assert {s.link: s.geometry.radius for s in solids_of(Body(thicker)) if s.link == "left_thigh"} == {
        "left_thigh": pytest.approx((0.072 * 1.2 + 0.068 * 1.1) / 2)
    }
    longer = thicker.scaled({"left_knee_flexion": 1.1}).flesh[k]
    np.testing.assert_allclose(np.divide(longer.core.size, longer.size), np.divide(thigh.core.size, thigh.size))


# link, height of the section above the link's origin [m], girth [m] of adults of 1.70 m
GIRTHS = [
    ("torso", 0.25, 0.93), ("lumbar_flexion_link", 0.0, 0.82), ("pelvis", 0.0, 0.97), ("neck", 0.05, 0.36),
    ("head", 0.03, 0.57), ("left_upper_arm", -0.15, 0.31), ("left_forearm", -0.07, 0.26),
    ("left_forearm", -0.25, 0.16), ("left_thigh", -0.09, 0.58), ("left_thigh", -0.38, 0.375),
    ("left_shank", -0.12, 0.37), ("left_shank", -0.385, 0.225),
]  # fmt: skip


@pytest.mark.parametrize(("link", "height", "girth"), GIRTHS)
def test_flesh_has_the_girths_of_an_average_adult(link: str, height: float, girth: float) -> None:
    """Tape measures, which bridge hollows, against the sources in human34.urdf."""
    part = next(f for f in load_subject("human34").flesh if f.link == link)
    section = Trimesh(*solid_mesh(part, 48, 48)).section([0.0, 0.0, 1.0], [0.0, 0.0, height])
    assert ConvexHull(section.vertices[:, :2]).area == pytest.approx(girth, rel=0.04)
