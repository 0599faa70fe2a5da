"""Lookup of a person from several cameras, and from the silhouette alone."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from builders import body_of

from estimator.data.formats.cameras import load_cameras
from estimator.data.image_cues import ImageCues
from estimator.search.examples.hashing import Bits, HashTables, packed, random_keys
from estimator.search.examples.index import ExampleIndex, IndexRecipe
from estimator.search.examples.lookup import Votes
from estimator.search.examples.person_seen import PersonView, standing_places
from estimator.synthesis.poses import PoseSampler
from estimator.vision.cues.depth import PersonPoints
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from estimator.vision.person_view import ViewFrame, square_transform
from humanoid.kinematics.body import ROOT_Q, Body
from humanoid.subject.subject import load_subject
from kinemode.shot import RenderedClip

UP = np.array([0.0, 0.0, 1.0])
APART = 40.0  # degrees between two cameras
EACH, BITS = 60, 96


@pytest.fixture(scope="module")
def looks() -> np.ndarray:
    """Descriptions (2 EACH, BITS) of examples."""
    return np.random.default_rng(1).integers(0, 2, (2 * EACH, BITS)).astype(np.uint16)


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    """Poses (2 EACH, nq): EACH + k is pose k seen from a camera APART from the first."""
    rng = np.random.default_rng(0)
    first = np.array([PoseSampler(body_of("human34"), headings=30.0).draw(rng) for _ in range(EACH)])
    second = first.copy()
    for q in second:
        q[ROOT_Q] = pin.SE3ToXYZQUAT(pin.SE3(turn(-APART), np.zeros(3)) * pin.XYZQUATToSE3(q[ROOT_Q]))
    return np.concatenate([first, second])


def votes_on(poses: np.ndarray, looks: np.ndarray) -> Votes:
    """An index of these poses with these descriptions."""
    body, rates = body_of("human34"), np.ones(BITS)
    bits = Bits(np.arange(BITS, dtype=np.int32), np.ones(BITS, np.uint16), rates, rates)
    tables = HashTables(packed(bits.of(looks)), random_keys(BITS, np.random.default_rng(0), 4, 4))
    return Votes(ExampleIndex(IndexRecipe(headings=120.0), body.q_names, 2.0, poses, bits, tables), body)


@pytest.fixture(scope="module")
def votes(poses: np.ndarray, looks: np.ndarray) -> Votes:
    return votes_on(poses, looks)


def turn(degrees: float) -> np.ndarray:
    return np.asarray(pin.utils.rotate("z", np.radians(degrees)))


def view(description: np.ndarray, azimuth: float = 0.0) -> PersonView:
    """The view of a person at some place, from an azimuth [degrees]."""
    nothing = np.zeros((0, 0))
    return PersonView(0, ViewFrame(np.array([1.0, 2.0, 0.9]), turn(azimuth)), nothing, nothing, description)


def elected(votes: Votes, views: list[PersonView], names: list[str], count: int) -> list[np.ndarray]:
    """The examples kept from twice as many proposals per view."""
    numbers = [votes.index.nearest(v.description, 2 * count).numbers for v in views]
    q = [votes.index.poses(n, v.frame) for n, v in zip(numbers, views, strict=True)]
    return [n[chosen] for n, chosen in zip(numbers, votes.elected(views, names, numbers, q, count), strict=True)]


def test_a_pose_is_the_example_that_another_camera_sees_of_it(votes: Votes) -> None:
    here, there = view(np.zeros(BITS)).frame, view(np.zeros(BITS), APART).frame
    numbers = np.arange(EACH)
    poses = votes.index.poses(numbers, here)
    np.testing.assert_array_equal(votes.examples(poses, here), numbers)
    np.testing.assert_array_equal(votes.examples(poses, there), EACH + numbers)
    assert np.all(votes.examples(poses, view(np.zeros(BITS), 120.0).frame) == -1)  # they face away from that camera


def test_two_cameras_that_see_the_same_choose_as_one(votes: Votes, looks: np.ndarray) -> None:
    seen = view(looks[7] ^ (np.arange(BITS) % 5 == 0))
    alone = votes.index.nearest(seen.description, 10).numbers
    (one_camera,) = elected(votes, [seen], ["a"], 10)
    np.testing.assert_array_equal(one_camera, alone)
    both = elected(votes, [seen, seen], ["a", "b"], 10)
    np.testing.assert_array_equal(both[0], alone)
    assert len(both[1]) == 0


def test_the_order_of_the_cameras_does_not_matter(votes: Votes, looks: np.ndarray) -> None:
    views = [view(looks[3]), view(looks[EACH + 20], APART), view(looks[40], 20.0)]
    names = ["a", "b", "c"]
    kept = elected(votes, views, names, 12)
    assert sum(map(len, kept)) == 12
    assert all(map(len, kept))
    turned = elected(votes, views[::-1], names[::-1], 12)
    for a, b in zip(kept, turned[::-1], strict=True):
        np.testing.assert_array_equal(a, b)


def test_moderate_agreement_of_two_cameras_outranks_one_camera(poses: np.ndarray, looks: np.ndarray) -> None:
    """Pose 5 differs from either picture by a fifth of the bits. Two others each differ from one picture by a tenth and
    are unlike the other."""
    rng, looks = np.random.default_rng(3), looks.copy()
    descriptions = [looks[k] ^ (rng.random(BITS) < 0.2) for k in (5, EACH + 5)]
    decoys = 30, EACH + 31
    for decoy, description in zip(decoys, descriptions, strict=True):
        looks[decoy] = description ^ (rng.random(BITS) < 0.1)
    votes = votes_on(poses, looks)
    assert [votes.index.nearest(d, 1).numbers[0] for d in descriptions] == list(decoys)
    views = [view(descriptions[0]), view(descriptions[1], APART)]
    first, second = elected(votes, views, ["a", "b"], 1)
    assert [k % EACH for k in (*first, *second)] == [5]  # proposed by either


def shown(clip: RenderedClip) -> tuple[Body, ImageCues, np.ndarray]:
    """The body of a rendered clip, cues of its first frame with exact depth, and its mask."""
    (camera,) = load_cameras(clip.cameras).values()
    videos, depths, masks = ([*files.values()] for files in (clip.videos, clip.depths, clip.masks))
    reader = CueReader(videos, [camera], cue_settings(["depth", "silhouette"]), depths=depths, masks=masks)
    (cues,) = reader.at(0)
    reader.close()
    return Body(load_subject(clip.subject)), cues, cues["silhouette"].mask


def test_height_gives_the_position_of_a_person(clip: RenderedClip) -> None:
    """The square from the silhouette equals that from depth within a few per cent of its side; a raised arm hardly
    moves it, and a person whose feet or head leave the picture has no position."""
    body, cues, mask = shown(clip)
    stature = float(np.ptp(body.landmarks(body.at(body.neutral))[:, 2]))
    person: PersonPoints = cues["depth"]
    by_depth = ViewFrame.at(person.points.places, cues.camera, UP)

    def standing(seen: np.ndarray) -> ViewFrame | None:
        places = standing_places(seen, cues.camera, UP, stature)
        return None if places is None else ViewFrame.at(places, cues.camera, UP)

    frame = standing(mask)
    assert frame is not None
    assert np.linalg.norm(frame.origin - by_depth.origin) < 0.15
    a, b = (square_transform(cues.camera, f, 2.0) for f in (by_depth, frame))
    assert b[0, 0] == pytest.approx(a[0, 0], rel=0.05)
    rows, columns = np.nonzero(mask)
    raised = mask.copy()
    side = columns.max()
    raised[rows.min() - 8 : rows.max() - 40, side - 2 : side] = True
    with_arm = standing(raised)
    assert with_arm is not None
    assert np.linalg.norm(with_arm.origin - frame.origin) < 0.25
    assert standing(np.roll(mask, len(mask) - 1 - rows.max(), axis=0)) is None
    assert standing(np.roll(mask, -rows.min(), axis=0)) is None
    assert standing(np.zeros_like(mask)) is None
