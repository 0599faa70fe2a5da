"""Kinematic jumps: the same image at another depth."""

from __future__ import annotations

import numpy as np
from builders import bent, body_of, camera_at, observe

from estimator.search.flips import REACHED, ROUGHLY, SAME, Flips, only_camera
from estimator.search.proposals import LimbProposal

CAMERA = camera_at(20.0, distance=3.5)


def test_flips_keep_the_rays_and_the_lengths() -> None:
    """Every flip moves one limb only; its middle and end stay on their rays, within what the search refines."""
    body = body_of("human34")
    q = bent(body, left_shoulder_elevation=0.9, left_elbow_flexion=0.8, right_hip_flexion=0.6, right_knee_flexion=0.9)
    before = body.landmarks(body.at(q))
    flips = Flips(body)
    assert len(flips.limbs) == 4
    found = list(flips.of(q, CAMERA))
    assert len(found) >= 4
    for other in found:
        after = body.landmarks(body.at(other))
        moved = np.linalg.norm(after - before, axis=1)
        limb = max(flips.limbs, key=lambda x: moved[x.landmarks].max())
        rest = [i for i in range(len(moved)) if not body.landmark_support[i][limb.dofs].any()]
        assert moved[rest].max() < 1e-12
        assert moved[limb.landmarks].max() > SAME - REACHED
        # a place within REACHED of a ray at 3.5 m is within this many pixels of it
        assert np.abs(CAMERA.project(after) - CAMERA.project(before))[limb.landmarks].max() < REACHED / 2.4 * 720.0
        assert np.all(other >= body.lower)
        assert np.all(other <= body.upper)


def test_a_body_without_limbs_has_no_flips() -> None:
    assert list(Flips(body_of("arm8")).of(body_of("arm8").neutral, CAMERA)) is not None
    assert Flips(body_of("upper13")).limbs[0].dofs.size == 4


def test_depth_is_open_to_one_camera_alone() -> None:
    body = body_of("human34")
    seen = observe(body, body.neutral, (CAMERA, camera_at(110.0)))
    assert only_camera(seen) is None
    seen.confidence[0] = 0.0
    assert only_camera(seen) is seen.cameras[1]


def test_limbs_change_places_in_the_image() -> None:
    body, rng = body_of("human34"), np.random.default_rng(4)
    flips = Flips(body)
    assert len(flips.pairs) == 2
    q = bent(body, left_hip_flexion=0.5, left_knee_flexion=0.4, right_hip_flexion=-0.1, right_knee_flexion=0.3)
    pixels = CAMERA.project(body.landmarks(body.at(q)))
    for _ in range(8):
        other = flips.exchange(rng, q, CAMERA)
        if other is None:
            continue
        after = CAMERA.project(body.landmarks(body.at(other)))
        for left, right in flips.pairs:
            ends = left.landmarks[1:], right.landmarks[1:]
            stayed = np.abs(after[ends[0]] - pixels[ends[0]]).max()
            exchanged = max(np.abs(after[a] - pixels[b]).max() for a, b in (ends, ends[::-1]))
            assert stayed < 1e-9 or exchanged < ROUGHLY * 3**0.5 / 2.4 * 720.0  # ROUGHLY is of each coordinate
        assert np.all((other >= body.lower) & (other <= body.upper))
        return
    raise AssertionError("no pair of limbs could change places")


def test_a_limb_is_tried_elsewhere_and_nothing_else_moves() -> None:
    body, rng = body_of("human34"), np.random.default_rng(5)
    proposal = LimbProposal(body)
    for _ in range(30):
        v = body.difference(body.neutral, proposal.sample(rng, body.neutral))
        moved = np.flatnonzero(np.abs(v) > 1e-12)
        assert np.all(moved >= 6)
        behind = [set(np.flatnonzero(body.support(int(body.tree.dof_joint[d])))) for d in moved]
        assert set.intersection(*behind) & set(moved.tolist()), "the joints moved hang on one of them"
