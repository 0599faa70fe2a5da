"""Anchors as a cue: where they begin, how they are followed, and what ends them."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

import kinemode as km
from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras import load_cameras
from estimator.data.image_cues import ImageCues
from estimator.runs.run_reader import Run
from estimator.vision.cues.anchors import COLUMNS, MOST, AnchorMatcher, AnchorReading, Anchors, AnchorSettings
from estimator.vision.cues.assigned import AssignedPoints
from estimator.vision.cues.base import PastPose
from estimator.vision.cues.image_likelihood import CameraLikelihood, ImageModel
from estimator.vision.cues.learned import LEARNED
from estimator.vision.cues.settings import cue_settings
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.explain import explain
from kinemode.shot import RenderedClip
from tests.command_lines import interrupted_after
from tests.tiny_clip import QUICK, named

EXTENT = 100.0  # px
SECONDS = 0.04


@dataclass(frozen=True)
class Scene:
    """A body before one camera that shows noise, which is texture everywhere."""

    model: ImageModel
    camera: Camera
    q: np.ndarray
    picture: np.ndarray

    def matcher(self, instant: int, now: np.ndarray, before: np.ndarray | None, learned: np.ndarray | None = None,
                **settings: float) -> AnchorMatcher:  # fmt: skip
        reading = AnchorReading(instant, now, before, learned)
        cues = replace(self.model.cues, anchors=AnchorSettings(**settings))
        model = ImageModel(self.model.body, cues, self.model.surface)
        camera = CameraLikelihood(model, ImageCues(self.camera, {"anchors": reading}), EXTENT)
        matcher = camera.matchers["anchors"]
        assert isinstance(matcher, AnchorMatcher)
        return matcher

    def learned(self, matcher: AnchorMatcher) -> np.ndarray:
        """What is learned at the pose."""
        prediction = matcher.view.predictor.predict(self.model.body.at(self.q))
        return matcher.learn(prediction, SECONDS, 1.0)

    def begun(self, **settings: float) -> np.ndarray:
        """The anchors that begin in the first picture."""
        return self.learned(self.matcher(0, self.picture, None, **settings))

    def term(
        self, matcher: AnchorMatcher, q_past: np.ndarray | None = None, q_left: np.ndarray | None = None
    ) -> AssignedPoints | None:
        """What ties a pose to a past, the scene's own pose unless given, or one that a jump left."""
        at = self.model.body.at
        past = PastPose(at(self.q if q_past is None else q_past), None, None if q_left is None else at(q_left))
        terms = matcher.since(matcher.follow([past])[0])
        assert all(isinstance(term, AssignedPoints) for term in terms)
        return terms[0] if terms else None  # type: ignore[return-value]


@pytest.fixture(scope="module")
def scene(clip: RenderedClip) -> Scene:
    ((_, camera),) = load_cameras(clip.cameras).items()
    body, width_height = Body(load_subject(clip.subject)), camera.image_size
    coarse = np.random.default_rng(0).normal(128.0, 40.0, (width_height[1] // 4 + 1, width_height[0] // 4 + 1))
    picture = np.kron(coarse, np.ones((4, 4)))[: width_height[1], : width_height[0]].clip(0, 255).astype(np.uint8)
    return Scene(ImageModel(body, cue_settings(["anchors"])), camera, np.load(clip.truth)["q"][0], picture)


def shifted(picture: np.ndarray, by: int) -> np.ndarray:
    return np.roll(picture, by, axis=1)


def test_anchors_begin_where_the_pose_has_visible_nodes(scene: Scene) -> None:
    anchors = Anchors.unpacked(scene.begun(), 0)
    prediction = scene.matcher(0, scene.picture, None).view.predictor.predict(scene.model.body.at(scene.q))
    assert 20 < len(anchors.node) <= MOST
    assert len(set(anchors.node)) == len(anchors.node)
    assert prediction.visible[anchors.node].all()
    assert anchors.place == pytest.approx(prediction.pixels[anchors.node])
    assert anchors.variance == pytest.approx((0.02 * EXTENT) ** 2)


def test_none_begins_where_nothing_can_be_followed(scene: Scene) -> None:
    even = np.full_like(scene.picture, 120)
    stripes = np.where(np.arange(even.shape[1]) // 8 % 2, 60, 200).astype(np.uint8)[None].repeat(len(even), axis=0)
    for picture in (even, stripes):
        assert not len(Anchors.unpacked(scene.learned(scene.matcher(0, picture, None)), 0).node)


def test_a_pose_is_drawn_to_where_its_anchors_went(scene: Scene) -> None:
    by, moved = 3, shifted(scene.picture, 3)
    term = scene.term(scene.matcher(1, moved, scene.picture, scene.begun()))
    assert term is not None
    features = term.features(scene.model.body.at(scene.q))
    way = features.target - features.pixels
    assert np.median(way, axis=0) == pytest.approx([by, 0.0], abs=0.1)
    assert np.mean(np.linalg.norm(way - [by, 0.0], axis=1) < 0.5) > 0.9


def test_an_anchor_counts_what_is_new(scene: Scene) -> None:
    """A pose away from its anchors is penalised once, where it leaves them, by a jump, too; over frames the energies of
    a way of poses add up to the last one's."""
    body, still = scene.model.body, scene.picture
    away = body.integrate(scene.q, 0.1 * np.eye(body.nv)[0])
    learned = scene.begun(drift=0.0)
    alone = scene.term(scene.matcher(1, still, still, learned, drift=0.0))
    assert alone is not None
    left = alone.value(body.at(away))
    assert left > 1.0
    kept = scene.term(scene.matcher(1, still, still, learned, drift=0.0), away)
    assert kept is not None
    assert kept.value(body.at(away)) == pytest.approx(0.0, abs=0.05)
    assert kept.value(body.at(scene.q)) == pytest.approx(-left, abs=0.05)
    jumped = scene.term(scene.matcher(1, still, still, learned, drift=0.0), away, scene.q)
    assert jumped is not None
    assert jumped.value(body.at(away)) == pytest.approx(left, abs=0.05)
    assert not alone.moves_with_past


def test_errors_of_an_anchor_do_not_add_up_over_frames(scene: Scene) -> None:
    """After many frames it is where the picture has it, to a fraction of what each frame might add."""
    learned, before, count = scene.begun(longest=10.0), scene.picture, 8
    first = Anchors.unpacked(learned, 0)
    for k in range(1, count + 1):
        now = shifted(scene.picture, k % 2)
        learned = scene.learned(scene.matcher(k, now, before, learned, longest=10.0))
        before = now
    last = Anchors.unpacked(learned, count)
    old = last.where(last.age > (count - 0.5) * SECONDS)
    assert len(old.node) > 0.8 * len(first.node)
    began = {int(n): place for n, place in zip(first.node, first.place, strict=True)}
    away = [np.linalg.norm(place - began[int(n)]) for n, place in zip(old.node, old.place, strict=True)]
    assert np.median(away) < 0.1
    assert old.variance == pytest.approx(first.variance[0] + count * AnchorSettings().drift ** 2)


def test_anchors_end_by_age_and_where_the_pose_leaves_them(scene: Scene) -> None:
    begun, still = scene.begun(), scene.picture
    aged = Anchors.unpacked(scene.learned(scene.matcher(1, still, still, begun, longest=0.5 * SECONDS)), 1)
    assert (aged.age == 0.0).all()
    kept = Anchors.unpacked(scene.learned(scene.matcher(1, still, still, begun)), 1)
    assert np.count_nonzero(kept.age > 0.0) > 0.9 * len(Anchors.unpacked(begun, 0).node)
    far = shifted(still, 12)  # six standard deviations, and the pose stays
    left = Anchors.unpacked(scene.learned(scene.matcher(1, far, still, begun)), 1)
    assert np.count_nonzero(left.age > 0.0) < 0.1 * np.count_nonzero(kept.age > 0.0)


def test_anchors_of_another_instant_or_surface_are_not_used(scene: Scene) -> None:
    begun, still = scene.begun(), scene.picture
    assert scene.term(scene.matcher(1, still, still, begun)) is not None
    assert scene.term(scene.matcher(2, still, still, begun)) is None
    assert scene.term(scene.matcher(1, still, None, begun)) is None
    other = begun.copy()
    other[0, 1] = 1e6
    with pytest.raises(InputError, match="on nodes that the body's"):
        scene.term(scene.matcher(1, still, still, other))


def track(clip: RenderedClip, out: Path, **changes: object) -> Run:
    how: dict[str, object] = {"fit": "off", "settings": QUICK, "mask": clip.masks, "cues": "edges,silhouette,anchors"}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return km.track("human34", **named(clip), out=out, **{**how, **changes})


def test_a_resumed_run_has_the_same_bits_and_explains_its_energy(clip: RenderedClip, tmp_path: Path) -> None:
    whole, out = track(clip, tmp_path / "a.run"), tmp_path / "b.run"
    with pytest.raises(KeyboardInterrupt), interrupted_after(2):
        track(clip, out)
    resumed = track(clip, out, resume=True)
    for name in ("mode_q", "mode_energy", "q"):
        assert getattr(resumed, name).tobytes() == getattr(whole, name).tobytes(), name
    last = len(whole) - 1
    assert whole.result(last).extra[f"{LEARNED}anchors"].shape == (1, MOST, COLUMNS)
    explained = explain(whole, last, 0)
    assert explained.total == pytest.approx(whole.mode_energy[last, 0], abs=1e-9)
    assert "anchors" in [part.name for part in explained.parts]
    assert "anchors" in [picture.name for view in explained.views for picture in view.pictures]
