"""Colours of limbs as a cue: what is learned, when it does not count, and where it takes limbs to end."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pytest

import kinemode as km
from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras import load_cameras
from estimator.data.image_cues import ImageCues
from estimator.data.observation import image_extent
from estimator.runs.run_reader import Run
from estimator.tracking.learning import stored_learning
from estimator.tracking.registry import make_tracker
from estimator.vision.cues.colour import ColourMatcher
from estimator.vision.cues.colour_matching import MATCHED, MISSING
from estimator.vision.cues.colour_model import (
    BEHIND,
    BINS,
    BRIGHTNESSES,
    LIMBS,
    RATIOS,
    ColourReading,
    LimbColours,
    colour_bins,
    differing,
    updated,
)
from estimator.vision.cues.image_likelihood import CameraLikelihood, ImageModel
from estimator.vision.cues.learned import LEARNED
from estimator.vision.resolution import scaled_camera
from estimator.vision.visibility import INNER, OUTER
from humanoid.kinematics.body import ROOT_PLACE_V, Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.explain import explain
from kinemode.shot import RenderedClip
from tests.command_lines import interrupted_after
from tests.tiny_clip import QUICK, named

SKIN, CLOTH, WALL = (110, 150, 215), (160, 90, 60), (90, 140, 100)
"""Blue, green and red."""
DARKER = 0.8


@dataclass(frozen=True)
class Scene:
    """A body before one camera, and the poses of its clip."""

    model: ImageModel
    camera: Camera
    q: np.ndarray

    def likelihood(self, picture: np.ndarray, learned: np.ndarray | None = None, at: int = 0) -> CameraLikelihood:
        """Of a picture by its colours alone."""
        reading = ColourReading(colour_bins(picture), learned)
        points = self.model.body.landmarks(self.model.body.at(self.q[at]))
        extent = image_extent(self.camera.project(points), np.ones(len(points)))
        return CameraLikelihood(self.model, ImageCues(self.camera, {"colour": reading}, picture), extent)

    def painted(self, q: np.ndarray, forearms: tuple[int, ...] = SKIN, rest: tuple[int, ...] = CLOTH) -> np.ndarray:
        """A picture of the body at q (nq,), in which the forearms have one colour and the rest another."""
        blank = np.empty((*self.camera.image_size[::-1], 3), np.uint8)
        blank[:] = WALL
        prediction = self.likelihood(blank).predictor.predict(self.model.body.at(q))
        left, top, size = prediction.frame
        y, x = np.indices(blank.shape[:2])
        row, column = (np.floor((a - b) / size + 0.5).astype(int) for a, b in ((y, top), (x, left)))
        rows, columns = prediction.owner.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        owner = np.where(inside, prediction.owner[row.clip(0, rows - 1), column.clip(0, columns - 1)], -1)
        is_forearm = np.array([*("forearm" in link for link in self.model.surface.links), False])
        blank[owner >= 0] = rest
        blank[is_forearm[owner]] = forearms
        return blank

    def learned(self, picture: np.ndarray, at: int = 0) -> np.ndarray:
        """What is learned from a picture of the pose `at`."""
        likelihood = self.likelihood(picture, at=at)
        learned = likelihood.matchers["colour"].learn(
            likelihood.predictor.predict(self.model.body.at(self.q[at])), 0.0, 1.0
        )
        assert learned is not None
        return learned


@pytest.fixture(scope="module")
def scene(clip: RenderedClip) -> Scene:
    ((_, camera),) = load_cameras(clip.cameras).items()
    return Scene(ImageModel(Body(load_subject(clip.subject))), scaled_camera(camera, 4.0), np.load(clip.truth)["q"])


def shifted(picture: np.ndarray, by: int) -> np.ndarray:
    """The picture with everything `by` pixels farther to the right; what comes in is the wall."""
    moved = np.roll(picture, by, axis=1)
    moved[:, :by] = WALL
    return moved


def test_shade_leaves_most_colours_in_their_bin_and_none_goes_far() -> None:
    lit = np.random.default_rng(0).integers(60, 256, (40, 40, 3)).astype(np.uint8)
    bright, dark = (
        np.stack(np.unravel_index(colour_bins(p), (RATIOS, RATIOS, BRIGHTNESSES)))
        for p in (lit, (DARKER * lit).astype(np.uint8))
    )
    moved = np.abs(bright - dark)
    assert moved.max() == 1
    assert np.mean(moved[:2].max(axis=0) == 0) > 0.7
    assert len(np.unique(colour_bins(np.array([[SKIN, CLOTH, WALL]], np.uint8)))) == 3


def test_equal_colours_count_nothing_and_other_colours_do() -> None:
    rng = np.random.default_rng(0)
    density = rng.dirichlet(np.full(30, 0.5))
    drawn = np.zeros((200, BINS))
    drawn[:, :30] = rng.multinomial(400, density, size=200)
    assert differing(drawn[:100], drawn[100:]).max() == 0.0
    other = np.roll(drawn[:1], 15, axis=1)
    assert differing(drawn[:1], other)[0, 0] == 1.0
    few = np.zeros((2, BINS))
    few[0, 3], few[1, 7] = 4.0, 4.0
    assert differing(few[:1], few[1:])[0, 0] == 0.0  # too few


def test_sleeves_of_the_colour_behind_them_are_off_and_others_are_not(scene: Scene) -> None:
    forearms = [i for i, link in enumerate(scene.model.surface.links) if "forearm" in link]
    camouflaged = scene.learned(scene.painted(scene.q[0], forearms=WALL))
    apart = LimbColours.of(camouflaged).apart
    assert np.all(apart[forearms, -1] == 0.0)
    assert apart[scene.model.surface.links.index("head"), -1] > 0.9
    likelihood = scene.likelihood(scene.painted(scene.q[0], forearms=WALL), camouflaged)
    matcher = likelihood.matchers["colour"]
    assert isinstance(matcher, ColourMatcher)
    prediction = likelihood.predictor.predict(scene.model.body.at(scene.q[0]))
    outer = np.isin(matcher._parts(prediction), forearms) & (prediction.contours.state == OUTER)
    (match, *_) = matcher.contours(prediction)
    assert outer.any()
    assert not np.isin(np.flatnonzero(outer), match.features.point).any()


@pytest.mark.parametrize("by", [0, 3, 5])
def test_a_body_displaced_in_the_picture_is_found_where_it_is(scene: Scene, by: int) -> None:
    picture = scene.painted(scene.q[0])
    likelihood = scene.likelihood(shifted(picture, by), scene.learned(picture))
    matcher = likelihood.matchers["colour"]
    assert isinstance(matcher, ColourMatcher)
    prediction = likelihood.predictor.predict(scene.model.body.at(scene.q[0]))
    offset, _, _, status = matcher.borders(prediction)
    across = prediction.contours.normals[:, 0]
    for state in (OUTER, INNER):
        chosen = (status == MATCHED) & (prediction.contours.state == state) & (np.abs(across) > 0.8)
        assert np.count_nonzero(chosen) > (20 if state == OUTER else 2)
        error = 0.5 if state == OUTER else 0.5 * prediction.frame[2]  # it was painted in cells of the depth buffer
        assert np.median(offset[chosen] / across[chosen]) == pytest.approx(by, abs=error)


def test_energy_is_least_at_the_true_pose(scene: Scene) -> None:
    body, picture = scene.model.body, scene.painted(scene.q[0])
    likelihood = scene.likelihood(picture, scene.learned(picture))
    energies = []
    for step in (-0.06, -0.03, 0.0, 0.03, 0.06):
        tangent = np.zeros(body.nv)
        tangent[ROOT_PLACE_V] = step * np.array([1.0, 1.0, 1.0]) / np.sqrt(3.0)
        energies.append(sum(likelihood.assigned_values(body.at(body.integrate(scene.q[0], tangent)))))
    assert int(np.argmin(energies)) == 2
    assert energies[0] > energies[1]
    assert energies[4] > energies[3]


def test_a_limb_that_is_not_there_is_missing(scene: Scene) -> None:
    picture = scene.painted(scene.q[0])
    bare = np.empty_like(picture)
    bare[:] = WALL
    likelihood = scene.likelihood(bare, scene.learned(picture))
    matcher = likelihood.matchers["colour"]
    assert isinstance(matcher, ColourMatcher)
    prediction = likelihood.predictor.predict(scene.model.body.at(scene.q[0]))
    *_, status = matcher.borders(prediction)
    counted = status[prediction.contours.state == OUTER]
    assert np.mean(counted == MISSING) > 0.8
    at_home = scene.likelihood(picture, scene.learned(picture))
    assert sum(likelihood.assigned_values(scene.model.body.at(scene.q[0]))) > 5.0 + sum(
        at_home.assigned_values(scene.model.body.at(scene.q[0]))
    )


def test_hidden_parts_keep_their_colours_and_visible_ones_follow_slowly() -> None:
    before, seen = np.zeros((2, 2, BINS), np.float16), np.zeros((2, 2, BINS), np.float32)
    before[LIMBS, :, 10], before[BEHIND, :, 200] = 50.0, 80.0
    seen[LIMBS, 0, 10], seen[LIMBS, 0, 11] = 30.0, 20.0
    seen[BEHIND, 0, 210] = 80.0
    after = updated(before, seen, 0.1, 0.5)
    assert after[:, 1].tobytes() == before[:, 1].tobytes()
    assert after[LIMBS, 0, [10, 11]] == pytest.approx([48.0, 2.0], rel=1e-3)
    assert after[BEHIND, 0, [200, 210]] == pytest.approx([40.0, 40.0])


def test_a_limb_that_looks_like_what_was_beside_it_is_not_learned() -> None:
    before = np.zeros((2, 1, BINS), np.float16)
    before[LIMBS, 0, 10], before[BEHIND, 0, 200] = 50.0, 80.0
    slid = before[::-1].copy()
    after = updated(before, slid, 0.5, 0.5)
    assert after[LIMBS].tobytes() == before[LIMBS].tobytes()


def test_a_hidden_limb_is_not_learned_from_what_hides_it(scene: Scene) -> None:
    """Of what the picture shows, only what the depth order has of a part is learned of it."""
    skin, cloth = (int(colour_bins(np.array([[c]], np.uint8))[0, 0]) for c in (SKIN, CLOTH))
    learned = scene.learned(scene.painted(scene.q[-1]), at=-1)[LIMBS]
    for link, counts in zip(scene.model.surface.links, learned, strict=True):
        own, other = (skin, cloth) if "forearm" in link else (cloth, skin)
        assert counts[own] == counts.sum()
        assert counts[other] == 0.0


@pytest.fixture(scope="module")
def tracked(clip: RenderedClip, tmp_path_factory: pytest.TempPathFactory) -> Run:
    return track(clip, tmp_path_factory.mktemp("run") / "a.run")


def track(clip: RenderedClip, out: Path, **changes: object) -> Run:
    how: dict[str, object] = {"fit": "off", "settings": QUICK, "mask": clip.masks, "cues": "edges,silhouette,colour"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return km.track("human34", **named(clip), out=out, **{**how, **changes})


def test_a_frame_has_what_was_learned_before_it(tracked: Run) -> None:
    name = f"{LEARNED}colour"
    assert name not in tracked.result(0).extra
    first, later = (tracked.result(t).extra[name] for t in (1, len(tracked) - 1))
    assert first.shape == (1, 2, len(ImageModel(tracked.body).surface.links), BINS)
    assert first[0, LIMBS].sum() > 100.0
    assert not np.array_equal(first, later)
    assert "learned_colour" not in tracked.extra


def test_its_energy_is_explained_with_what_was_learned(tracked: Run) -> None:
    for t in (0, 1, len(tracked) - 1):
        explained = explain(tracked, t, 0)
        assert explained.total == pytest.approx(tracked.mode_energy[t, 0], abs=1e-9)
        labels = [part.name for part in explained.parts]
        for label in ("colour", "limb of another colour, or hidden", "colours within limbs"):
            assert labels.count(label) == (t > 0)
        pictures = [picture.name for view in explained.views for picture in view.pictures]
        assert ("colour" in pictures) == (t > 0)


def test_a_resumed_run_has_the_same_bits(clip: RenderedClip, tracked: Run, tmp_path: Path) -> None:
    out = tmp_path / "b.run"
    with pytest.raises(KeyboardInterrupt), interrupted_after(2):
        track(clip, out)
    resumed = track(clip, out, resume=True)
    for name in ("mode_q", "mode_energy", "mode_covariance", "q"):
        assert getattr(resumed, name).tobytes() == getattr(tracked, name).tobytes(), name
    for t in range(1, len(tracked)):
        here, there = (run.result(t).extra[f"{LEARNED}colour"] for run in (resumed, tracked))
        assert here.tobytes() == there.tobytes()


def test_learned_colours_of_another_shape_are_refused(scene: Scene) -> None:
    picture = scene.painted(scene.q[0])
    learned = scene.learned(picture)
    reading = ColourReading(colour_bins(picture))
    with pytest.raises(InputError, match="have the shape"):
        reading.with_learned(learned[:, :, 1:])
    with pytest.raises(InputError, match=r"are of .* parts, the body has"):
        scene.likelihood(picture, learned[:, 1:])


def test_a_damaged_state_is_refused(tracked: Run, tmp_path: Path) -> None:
    tracker = make_tracker("css", tracked.body)
    learned = tracked.result(1).extra[f"{LEARNED}colour"]
    state = {f"last_{LEARNED}colour": learned, "last_time_learned": np.array(0.2)}
    stored = stored_learning(tracker, state, tmp_path / "a.run")
    assert {name: array.tobytes() for name, array in stored.arrays().items()} == {
        name: array.tobytes() for name, array in state.items()
    }
    for damaged in (np.full_like(learned, np.nan), learned.astype(int), learned[0, 0, 0]):
        with pytest.raises(InputError, match=r"a\.run.*state.*is damaged: what colour learned"):
            stored_learning(tracker, {**state, f"last_{LEARNED}colour": damaged}, tmp_path / "a.run")


def test_a_picture_shows_which_limbs_count(tracked: Run) -> None:
    (view,) = explain(tracked, len(tracked) - 1, 0).views
    (picture,) = [picture for picture in view.pictures if picture.name == "colour"]
    assert picture.base.shape == (*tracked.header.cameras[0].image_size[::-1], 3)
    assert {colour for _, colour in picture.legend} >= {"good", "bad", "muted"}
    assert cv2.countNonZero(picture.base.max(axis=2)) > 0
