"""ELMO: a person's view, examples and their index, and the trackers that search from it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pinocchio as pin
import pytest
from builders import body_of, camera_at, random_pose

import kinemode as km
from estimator.data.formats.cameras import load_cameras
from estimator.data.image_cues import ImageCues
from estimator.data.observation import Observation
from estimator.inference.mixture import Mode, mixture_of
from estimator.inference.origin import Family, Origin, PreviousPose
from estimator.search.examples.index import ExampleIndex, IndexRecipe, load_index
from estimator.search.examples.lookup import Lookup, either_way
from estimator.search.frame_search import FrameProblem
from estimator.search.from_examples import _best, _in_full, example_starts, turned_round, without_silhouette
from estimator.search.hypothesis import Candidate, Hypothesis
from estimator.synthesis import training
from estimator.synthesis.pictures import ExamplePainter, variants
from estimator.synthesis.poses import PoseSampler
from estimator.synthesis.training import PAIRS_AT_ONCE, train_index
from estimator.trackers.elmo.tracker import Elmo, ElmoState
from estimator.tracking.registry import make_tracker, settings_for
from estimator.vision.cues.cue_picture import Dots
from estimator.vision.cues.image_likelihood import ImageLikelihood
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from estimator.vision.person_view import SIDE, ViewFrame, bin_count, cut_out
from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import ROOT_Q, Body, PosedBody
from humanoid.subject.subject import load_subject, subject_from_text
from humanoid.support.errors import InputError
from kinemode.explain import explain
from kinemode.shot import RenderedClip
from kinemode.testing import check_tracker
from tests.test_tracker_contract import BY_DEPTH
from tests.tiers import later
from tests.tiny_clip import named

SMALL = IndexRecipe(examples=250, headings=120.0, pairs=120, variants=2, tables=10, key_bits=12)
UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def index(small_index: ExampleIndex) -> ExampleIndex:
    assert small_index.recipe == SMALL
    return small_index


@pytest.fixture
def file(small_index_file: Path) -> Path:
    return small_index_file


@pytest.mark.parametrize("azimuth", [0.0, 130.0])
def test_the_view_s_frame_is_the_person_s_as_the_camera_sees_them(azimuth: float) -> None:
    camera = camera_at(azimuth, distance=3.0, height=1.5, aim=(0.2, 0.1, 1.0))
    places = np.array([0.2, 0.1, 1.0]) + 0.3 * np.random.default_rng(0).standard_normal((501, 3))
    frame = ViewFrame.at(places, camera, UP)
    np.testing.assert_allclose(frame.R_world_view @ frame.R_world_view.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(frame.R_world_view[:, 2], UP)
    towards = frame.R_world_view.T @ (camera.centre_world - frame.origin)
    assert towards[0] < 0.0
    assert abs(towards[1]) < 1e-9
    assert frame.elevation(camera) == pytest.approx(np.degrees(np.arctan2(towards[2], -towards[0])))


def test_the_cut_out_does_not_depend_on_the_distance() -> None:
    """A bright disc of 0.5 m in a square of 2 m takes up a quarter of it, near or far."""
    for distance in (2.0, 5.0):
        camera = camera_at(0.0, distance=distance, height=1.0, aim=(0.0, 0.0, 1.0), focal=600.0)
        y, x = np.mgrid[: camera.image_size[1], : camera.image_size[0]]
        u, v = camera.project(np.array([0.0, 0.0, 1.0]))
        mask = np.hypot(x - u, y - v) < 0.25 * 600.0 / distance
        frame = ViewFrame(np.array([0.0, 0.0, 1.0]), np.eye(3))
        square, where = cut_out(np.where(mask, 200, 30).astype(np.uint8), mask, camera, frame, 2.0)
        assert square.shape == (SIDE, SIDE)
        across = np.count_nonzero(square[SIDE // 2] > 115)
        assert across == pytest.approx(SIDE / 4, abs=2)
        assert np.count_nonzero(where[SIDE // 2]) == pytest.approx(SIDE / 4 + 2, abs=3)  # and some rim


@pytest.mark.parametrize("name", ["human34", "upper13", "arm8"])
def test_drawn_poses_are_free_of_overlaps_and_similar_ones_near(name: str) -> None:
    body, rng = body_of(name), np.random.default_rng(1)
    sampler, collision = PoseSampler(body, headings=60.0), SelfCollision(body)
    drawn = np.array([sampler.draw(rng) for _ in range(40)])
    assert all(collision.penetration(body.at(q)) <= 0.005 for q in drawn)
    for q in drawn[:10]:
        assert np.all(q >= body.lower - 1e-9)
        assert np.all(q <= body.upper + 1e-9)
        near = body.landmarks(body.at(sampler.near(q, rng, 0.05))) - body.landmarks(body.at(q))
        assert 0.0 < np.linalg.norm(near, axis=1).max() <= 0.05
    elbow = body.q_names.index("left_elbow_flexion")
    assert np.ptp(drawn[:, elbow]) > 0.7 * (body.upper[elbow] - body.lower[elbow])  # all over the limits
    if body.has_free_root:
        faced = np.array([pin.XYZQUATToSE3(q[ROOT_Q]).rotation[:, 0] for q in drawn])
        assert np.degrees(np.arccos(-faced[:, 0])).max() <= 30.0 + 1e-9
        knee = body.q_names.index("left_knee_flexion")
        legs = PoseSampler(body, legs=True)
        assert np.std([legs.draw(rng)[knee] for _ in range(40)]) > 2.0 * drawn[:, knee].std()


def test_an_example_is_described_as_it_lies_before_the_camera() -> None:
    body, rng = body_of("human34"), np.random.default_rng(2)
    painter = ExamplePainter(body, variants(body.subject, 2, rng), 8.0, 2.2)
    q = PoseSampler(body, headings=0.0).draw(rng)
    made = painter.example(q, rng)
    assert made.description.shape == (bin_count(),)
    assert made.description.sum() > 500
    assert 0.02 < made.where.mean() < 0.4
    np.testing.assert_array_equal(made.q[ROOT_Q.stop :], q[ROOT_Q.stop :])
    root = pin.XYZQUATToSE3(made.q[ROOT_Q])
    assert root.rotation[0, 0] < -0.9  # x of the view leads away from the camera, which the body faces
    assert abs(root.translation[2]) < 0.4
    np.testing.assert_allclose(made.landmarks.mean(axis=0), 0.0, atol=1e-12)


def test_the_index_is_the_same_with_any_number_of_processes_and_after_an_interruption(tmp_path: Path) -> None:
    tiny = replace(SMALL, pairs=PAIRS_AT_ONCE + 1, examples=40, key_bits=4)  # two batches of pairs, one of examples
    index = train_index(load_subject("arm8"), tiny)
    assert index.q.shape == (40, body_of("arm8").nq)

    class Stopped(Exception):  # noqa: N818, not an error
        pass

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise Stopped

    with pytest.raises(Stopped):
        train_index(load_subject("arm8"), tiny, parts=tmp_path, progress=stop)
    kept = sorted(tmp_path.iterdir())
    assert [path.name for path in kept] == ["pairs_0000.npz", "pairs_0001.npz"]
    kept[1].write_bytes(kept[1].read_bytes()[:1000])  # a damaged one is done again
    steps: list[tuple[int, int]] = []
    again = train_index(load_subject("arm8"), tiny, parts=tmp_path, processes=2, progress=lambda *at: steps.append(at))
    assert steps[-1] == (3, 3)
    for a, b in (
        (index.q, again.q), (index.tables.codes, again.tables.codes), (index.bits.feature, again.bits.feature),
        (index.tables.chosen, again.tables.chosen),
    ):  # fmt: skip
        np.testing.assert_array_equal(a, b)


def test_pieces_of_another_index_are_not_taken(tmp_path: Path) -> None:
    own, other = (training._PieceStore(tmp_path, what) for what in ("one", "another"))
    own.put("pairs", 0, {"a": np.arange(3)})
    piece = own.of("pairs", 0)
    assert piece is not None
    np.testing.assert_array_equal(piece["a"], np.arange(3))
    assert other.of("pairs", 0) is None


def test_similar_examples_are_found(index: ExampleIndex) -> None:
    """A pose of the index, painted again with other clothes and light, is nearer to the found examples than to random
    poses."""
    body, rng = body_of("human34"), np.random.default_rng(5)
    painter = ExamplePainter(body, variants(body.subject, 2, rng), 8.0, index.side)
    sampler = PoseSampler(body)

    def landmarks(q: np.ndarray) -> np.ndarray:
        return body.landmarks(body.at(q.astype(float)))

    known = np.array([landmarks(q) for q in index.q])
    nearest, all_of_them = [], []
    for _ in range(20):
        made = painter.example(sampler.draw(rng), rng)
        away = np.linalg.norm(known - landmarks(made.q), axis=2).mean(axis=1)
        near = index.nearest(made.description, 25)
        nearest.append(away[near.numbers].mean())
        all_of_them.append(away.mean())
    assert np.mean(nearest) < 0.9 * np.mean(all_of_them)


def test_poses_are_put_where_the_person_is_seen(index: ExampleIndex) -> None:
    body = body_of("human34")
    frame = ViewFrame(np.array([2.0, -1.0, 0.9]), pin.utils.rotate("z", 0.7))
    placed = index.poses(np.array([3, 8]), frame)
    for pose, own in zip(placed, index.q[[3, 8]].astype(float), strict=True):
        own[3:7] /= np.linalg.norm(own[3:7])
        there = body.landmarks(body.at(own)) @ frame.R_world_view.T + frame.origin
        np.testing.assert_allclose(body.landmarks(body.at(pose)), there, atol=1e-6)


def test_the_file_keeps_the_index(index: ExampleIndex, file: Path) -> None:
    loaded = load_index(file, body_of("human34"))
    assert (loaded.recipe, loaded.side, loaded.q_names) == (index.recipe, index.side, index.q_names)
    description = np.random.default_rng(0).integers(0, 20, bin_count()).astype(np.uint16)
    np.testing.assert_array_equal(loaded.nearest(description, 30).numbers, index.nearest(description, 30).numbers)


def changed(file: Path, to: Path, change: Callable[[dict[str, np.ndarray]], None]) -> Path:
    with np.load(file) as stored:
        arrays = {name: stored[name] for name in stored.files}
    change(arrays)
    np.savez(to, **arrays)
    return to


def header(**changes: Any) -> Callable[[dict[str, np.ndarray]], None]:
    def change(arrays: dict[str, np.ndarray]) -> None:
        arrays["header"] = np.array(json.dumps(json.loads(str(arrays["header"])) | changes))

    return change


def recipe(**changes: Any) -> Callable[[dict[str, np.ndarray]], None]:
    def change(arrays: dict[str, np.ndarray]) -> None:
        header(recipe=json.loads(str(arrays["header"]))["recipe"] | changes)(arrays)

    return change


BROKEN: dict[str, tuple[Callable[[dict[str, np.ndarray]], None], str]] = {
    "of another kind": (lambda a: a.pop("codes"), "is not an index of examples"),
    "format": (header(format=7), "is of format 7, this kinemode reads 2"),
    "subject": (header(q_names=["a", "b"]), "is of another subject than human34: its coordinates are a, b"),
    "recipe": (header(recipe={"colour": 1}), "is damaged"),
    "side": (header(side=-1.0), "is damaged: a side of -1 m"),
    "header": (lambda a: a.update(header=np.array("{")), "is damaged: its header is not JSON"),
    "poses": (lambda a: a.update(q=a["q"][:, :5]), "is damaged: q has the shape"),
    "codes": (lambda a: a.update(codes=a["codes"][:, :1]), "is damaged: codes of 1 words"),
    "bits": (lambda a: a.update(feature=a["feature"] + 20_000), "is damaged: feature has numbers beyond"),
    "keys": (lambda a: a.update(keys=a["keys"] - 10_000), "is damaged: keys has numbers beyond"),
    "no quaternion": (lambda a: a["q"].__setitem__((0, slice(3, 7)), 0.0), "is damaged: q is not a configuration"),
    "objects": (lambda a: a.update(q=np.array([{}])), "cannot be read"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_an_invalid_file_is_reported(kind: str, file: Path, tmp_path: Path) -> None:
    change, message = BROKEN[kind]
    broken = changed(file, tmp_path / "broken.npz", change)
    with pytest.raises(InputError, match=message):
        load_index(broken, body_of("human34"))


def test_invalid_training_input_is_refused(tmp_path: Path) -> None:
    bare = subject_from_text(load_subject("arm8").urdf.replace("flesh", "fl"), source="bare", base="fixed")
    with pytest.raises(InputError, match="bare: has no flesh"):
        train_index(bare, SMALL)
    for few in (replace(SMALL, examples=50), replace(SMALL, pairs=5)):
        with pytest.raises(InputError, match="too few for keys of 12 bits"):
            train_index(load_subject("arm8"), few)
    out = tmp_path / "a.npz"
    for how, message in (
        ({"headings": 400.0}, "headings: must be 0 to 360 degrees"),
        ({"elevation": 80.0}, "elevation: must be -10 to 60 degrees"),
        ({"examples": 0}, "examples: must be 1 or more"),
        ({"workers": 0}, "workers: 0"),
        ({"out": tmp_path / "no" / "a.npz"}, "folder"),
    ):
        with pytest.raises(InputError, match=message):
            km.train_index("arm8", **{"out": out, **how})
    out.write_text("")
    with pytest.raises(InputError, match="exists already"):
        km.train_index("arm8", out)


def tracked(clip: RenderedClip, **how: Any) -> km.Run:
    given = {**named(clip), "keypoints": None, "depth": clip.depths, "cues": "depth", "fit": "off"}
    return km.track(clip.subject, **{**given, **how})


@pytest.mark.paper
def test_elmo_needs_no_keypoints_and_resumes_to_the_same_bits(clip: RenderedClip, file: Path, tmp_path: Path) -> None:
    few = {"elmo": {"neighbours": 12, "rounds": 2, "survivors": 6, "limbs": 100}}
    run = tracked(clip, tracker="elmo", index=file, settings=few, out=tmp_path / "a.run")
    assert [run.result(i).status for i in range(len(run))] == ["tracked"] * len(run)
    error = km.evaluate(run, clip.truth)
    assert error.mpjpe < 0.2  # from 250 examples and nothing else
    assert run.result(1).extra["searches_example"] == 12
    assert run.result(1).extra["searches_parent"] >= 1
    assert run.result(1).extra["looked_at"] >= 12
    first = explain(run, 0)  # ranked with evidence that its energy is without
    assert sum(part.energy for part in first.parts) == pytest.approx(first.stored, abs=1e-6)
    explained = explain(run, 2)
    (shown,) = [picture for view in explained.views for picture in view.pictures if picture.name == "examples"]
    assert shown.base.shape[:2] == explained.views[0].image.shape[:2]
    assert all(len(layer.at if isinstance(layer, Dots) else layer.start) for layer in shown.layers)


def test_a_state_is_stored_to_the_last_bit() -> None:
    body, rng = body_of("arm8"), np.random.default_rng(0)
    modes = tuple(
        Mode(random_pose(body, rng), np.diag(rng.uniform(0.1, 1.0, 8)), 1.0, "converged", np.zeros(8)) for _ in range(3)
    )
    state = ElmoState(mixture_of(modes, rng.standard_normal(3)), 2.0, 1.5)
    tracker = make_tracker("elmo", body, settings_for("elmo"))
    again = tracker.state_from(state.arrays())
    for name, array in state.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array)
    with pytest.raises(ValueError, match="the person was seen at 9 s, after 2"):
        tracker.state_from(state.arrays() | {"seen": np.array(9.0)})


def depth_frames(clip: RenderedClip, count: int, cues: Sequence[str] = ("depth",)) -> Iterator[Observation]:
    (camera,) = load_cameras(clip.cameras).values()
    videos, depths, plates = (list(of.values()) for of in (clip.videos, clip.depths, clip.plates))
    reader = CueReader(videos, [camera], cue_settings(cues), depths=depths, plates=plates)
    nothing = np.full((1, len(Body(load_subject(clip.subject)).landmark_names), 2), np.nan)
    for i in range(count):
        yield Observation(i, i / 5.0, (camera,), nothing, np.zeros(nothing.shape[:2]), cues=reader.at(i))
    reader.close()


@pytest.mark.parametrize("name", later(BY_DEPTH, thorough=["psh"]))
def test_trackers_by_depth_keep_the_contract(name: str, clip: RenderedClip, file: Path) -> None:
    settings = settings_for(
        name, changes={"search": {"index": str(file)}, "elmo": {"neighbours": 6, "rounds": 2, "limbs": 50}}
    )
    body = Body(load_subject(clip.subject))
    check_tracker(lambda: make_tracker(name, body, settings), list(depth_frames(clip, 3)), seed=1, continues=(0,))


def test_a_second_camera_brings_no_more_starts(clip: RenderedClip, file: Path) -> None:
    """The second camera sees the same: the lookup equals that of one camera unless voting is off; both have a
    picture."""
    (first,) = depth_frames(clip, 1)
    (camera,), (cues,) = first.cameras, first.cues
    body = Body(load_subject(clip.subject))

    def seen_by(count: int, **own: Any) -> tuple[Elmo, Observation]:
        cameras = tuple(replace(camera, name=f"{camera.name}_{k}") for k in range(count))
        nothing = np.full((count, len(body.landmark_names), 2), np.nan)
        observation = Observation(0, 0.0, cameras, nothing, np.zeros(nothing.shape[:2]), cues=(cues,) * count)
        changes = {"search": {"index": str(file)}, "elmo": {"neighbours": 8, "rounds": 1, **own}}
        tracker = make_tracker("elmo", body, settings_for("elmo", changes=changes))
        assert isinstance(tracker, Elmo)
        return tracker, observation

    def lookups(count: int, **own: Any) -> list[list[int]]:
        tracker, observation = seen_by(count, **own)
        return [lookup.neighbours.numbers.tolist() for lookup in tracker.lookups(observation)]

    (alone,), (proposed,) = lookups(1), lookups(1, neighbours=16)
    assert lookups(2) == [proposed[:8], []]  # with voting, more examples are searched
    assert lookups(2, votes=False) == [alone, alone]
    tracker, observation = seen_by(2)
    _, result = tracker.init(np.random.default_rng(0), observation)
    assert result.extra["searches_example"] == 8
    assert set(tracker.pictures(observation, result)) == {0, 1}


def test_psh_takes_an_example_as_it_is_and_icp_the_first_pose(clip: RenderedClip, file: Path) -> None:
    psh = tracked(clip, tracker="psh", index=file, end=0.2)
    index = load_index(file, psh.body)
    angles = psh.q[0][ROOT_Q.stop :]
    assert np.abs(index.q[:, ROOT_Q.stop :] - angles).max(axis=1).min() < 1e-5
    icp = tracked(clip, tracker="icp", keypoints=clip.first_frame, end=0.4)
    assert km.evaluate(icp, clip.truth).mpjpe < 0.06


def test_without_depth_the_silhouette_is_used(clip: RenderedClip, file: Path, tmp_path: Path) -> None:
    """Edges and outline without a background; also where the feet leave the picture and only the last modes
    continue."""
    (folder,) = clip.masks.values()
    for k, path in enumerate(sorted(folder.iterdir())):
        mask = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if k == 3:
            mask[np.nonzero(mask)[0].max() - 2 :] = 255
        cv2.imwrite(str(tmp_path / path.name), mask)
    few = {"elmo": {"neighbours": 12, "rounds": 2, "survivors": 6, "limbs": 100}}
    how: dict[str, Any] = {"depth": None, "mask": tmp_path, "cues": "silhouette,edges", "index": file}
    run = tracked(clip, tracker="elmo", settings=few, **how)
    assert all(run.result(i).status != "unobserved" for i in range(len(run)))
    assert run.result(2).extra["looked_at"] >= 12
    assert run.result(3).extra["looked_at"] == 0
    assert km.evaluate(run, clip.truth).mpjpe < 0.35  # from 250 examples, and depth is a guess
    psh = tracked(clip, tracker="psh", **how)
    seen = [psh.result(i).status != "unobserved" for i in range(len(psh))]
    assert seen == [True, True, True, False, True]


def test_icp_stays_where_no_person_is_seen(clip: RenderedClip, tmp_path: Path) -> None:
    (folder,) = clip.depths.values()
    for k, path in enumerate(sorted(folder.iterdir())):
        depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(tmp_path / path.name), np.zeros_like(depth) if k == 2 else depth)
    run = tracked(clip, tracker="icp", keypoints=clip.first_frame, depth=tmp_path)
    assert [run.result(i).status for i in range(len(run))] == ["tracked"] * 2 + ["unobserved"] + ["tracked"] * 2
    np.testing.assert_array_equal(run.q[2], run.q[1])


def test_missing_input_is_reported_before_any_work(clip: RenderedClip, file: Path, tmp_path: Path) -> None:
    cases: list[tuple[dict[str, Any], str]] = [
        (
            {"tracker": "elmo", "index": file, "depth": None, "cues": "edges"},
            "elmo needs depth or silhouette, which is not used",
        ),
        ({"tracker": "css-paper", "index": file, "keypoints": clip.first_frame}, "index: css-paper looks nothing up"),
        ({"tracker": "elmo", "index": tmp_path / "none.npz"}, "there is no such file"),
        (
            {"tracker": "psh", "index": changed(file, tmp_path / "high.npz", recipe(elevation=50.0))},
            "its camera looks down by 50 degrees, cam01 by [0-9]*: too little .* train-index SUBJECT --elevation",
        ),
        ({"tracker": "elmo", "index": clip.truth}, "is not an index of examples"),
        ({"tracker": "icp"}, "keypoints"),
    ]
    for how, message in cases:
        with pytest.raises(InputError, match=message):
            tracked(clip, **how)


def test_settled_modes_agree_better_with_picture_and_past(clip: RenderedClip, file: Path) -> None:
    """From one state: the modes of the product have less energy, including the transition, than the likelihood's."""
    body, frames = Body(load_subject(clip.subject)), list(depth_frames(clip, 2))

    def stepped(settle: bool) -> tuple[Elmo, ElmoState, ElmoState]:
        few = {"neighbours": 12, "rounds": 2, "survivors": 4, "settle": settle}
        changes = {"search": {"index": str(file)}, "elmo": few, "cost": {"turn_speed": 1.0}}
        tracker = make_tracker("elmo", body, settings_for("elmo", changes=changes))
        assert isinstance(tracker, Elmo)
        rng = np.random.default_rng(0)
        before, _ = tracker.init(rng, frames[0])
        return tracker, before, tracker.step(rng, before, frames[1])[0]

    tracker, before, settled = stepped(True)
    _, _, likely = stepped(False)
    likelihood = tracker.search.likelihood(frames[1], before.mixture.modes[0].q)
    case = FrameProblem(tracker.search.associations(frames[1]), frames[1].time - frames[0].time, likelihood)
    search = tracker.search.frame(case)

    def energy(mode: Mode) -> float:
        parent = before.mixture.modes[mode.parent]
        return -search.score(Hypothesis(mode.q, 0, Origin(Family.KEPT, PreviousPose(parent.q))))

    a, b = settled.mixture.modes[0], likely.mixture.modes[0]
    assert a.parent == b.parent >= 0
    assert energy(a) < energy(b) - 0.1
    np.testing.assert_allclose(a.velocity, body.velocity(before.mixture.modes[a.parent].q, a.q, case.dt))


def test_the_silhouette_ranks_and_refines_what_depth_has_found(clip: RenderedClip, file: Path) -> None:
    """Modes by both cues have less energy than those by depth alone, and searches from examples do not use the
    silhouette."""
    body, few = Body(load_subject(clip.subject)), {"neighbours": 12, "rounds": 2, "survivors": 4}
    (by_depth,), (by_both,) = (list(depth_frames(clip, 1, cues)) for cues in (("depth",), ("depth", "silhouette")))
    tracker = make_tracker("elmo", body, settings_for("elmo", changes={"search": {"index": str(file)}, "elmo": few}))
    assert isinstance(tracker, Elmo)
    likelihood = tracker.search.likelihood(by_both, body.neutral)
    case = FrameProblem(tracker.search.associations(by_both), 0.0, likelihood)
    search = tracker.search.frame(case)
    energy = [
        -search.score(
            Hypothesis(tracker.init(np.random.default_rng(0), seen)[0].mixture.modes[0].q, 0, Origin(Family.KEPT))
        )
        for seen in (by_depth, by_both)
    ]
    assert energy[1] < energy[0] - 1.0
    assert without_silhouette(tracker.search, by_depth, case, body.neutral) is case
    wide = without_silhouette(tracker.search, by_both, case, body.neutral).likelihood
    assert wide is not None
    assert [set(camera.cues) for camera in wide.cameras] == [{"depth"}]


def facing(body: Body, heading: float, q: np.ndarray | None = None) -> np.ndarray:
    """A pose (nq,), by default the neutral one, at the origin and turned by a heading [rad]."""
    turned = (body.neutral if q is None else q).copy()
    turned[ROOT_Q] = pin.SE3ToXYZQUAT(pin.SE3(pin.utils.rotate("z", heading), np.zeros(3)))
    return turned


def mode_at(body: Body, q: np.ndarray) -> Mode:
    return Mode(q, 0.01 * np.eye(body.nv), 0.0, "converged", np.zeros(body.nv))


def elmo(body: Body, **changes: Any) -> Elmo:
    tracker = make_tracker("elmo", body, settings_for("elmo", changes={"elmo": changes}))
    assert isinstance(tracker, Elmo)
    return tracker


def seen_by(body: Body, time: float, cue: str) -> Observation:
    camera, nothing = camera_at(0.0), np.full((1, len(body.landmark_names), 2), np.nan)
    cues = (ImageCues(camera, {cue: "seen"}),)
    return Observation(1, time, (camera,), nothing, np.zeros(nothing.shape[:2]), cues=cues)


def test_an_early_silhouette_constrains_the_heading_less() -> None:
    """Modes facing as before or turned round, each with one limb moved: the best of both headings differ by less within
    `correlated`, but not after it or without a silhouette; limbs never do."""
    body = body_of("human34")
    bent = [body.integrate(body.neutral, np.eye(body.nv)[-1] * angle) for angle in (0.0, 0.4)]
    modes = [mode_at(body, facing(body, heading, q)) for heading in (0.0, np.pi) for q in bent]
    likely = mixture_of(tuple(modes), np.array([-4.0, -5.0, 0.0, -3.0]))
    state = ElmoState(mixture_of(tuple(modes[:1]), np.zeros(1)), 1.0, 1.0)

    def scores(correlated: float, dt: float, cue: str = "silhouette") -> np.ndarray:
        renewed = elmo(body, correlated=correlated)._as_new(likely, state, seen_by(body, 1.0 + dt, cue))
        return np.array([renewed[[m.q.tobytes() for m in likely.modes].index(mode.q.tobytes())] for mode in modes])

    whole = scores(0.0, 0.05)
    np.testing.assert_allclose(whole - whole[2], [-4.0, -5.0, 0.0, -3.0])
    soon = scores(0.2, 0.05)
    np.testing.assert_allclose(soon - soon[2], [-1.0, -2.0, 0.0, -3.0])
    np.testing.assert_array_equal(scores(0.2, 0.3), whole)
    np.testing.assert_array_equal(scores(0.2, 0.05, "depth"), whole)


def test_people_walk_forwards() -> None:
    """Two modes at one place, one turned round, each continuing one of the last frame: they differ by the nats of the
    way between, forwards for one and backwards for the other."""
    body = body_of("human34")
    before = tuple(mode_at(body, facing(body, heading)) for heading in (0.0, np.pi))
    moved = [mode.q.copy() for mode in before]
    for q in moved:
        q[0] += 0.1  # m, along where the first faces
    likely = mixture_of(tuple(mode_at(body, q) for q in moved), np.zeros(2))
    state = ElmoState(mixture_of(before, np.zeros(2)), 1.0, 1.0)
    for nats in (0.0, 5.0):
        weighed = elmo(body, forwards=nats)._weighed(likely, state, seen_by(body, 2.0, "depth"))
        ahead = [mode.q.tobytes() for mode in weighed.modes].index(moved[0].tobytes())
        ahead_score, back_score = weighed.log_scores[[ahead, 1 - ahead]]
        assert ahead_score - back_score == pytest.approx(2.0 * 0.1 * nats, abs=1e-6)


@pytest.mark.parametrize("headings", [True, False])
def test_the_best_mode_that_is_turned_round_is_kept(clip: RenderedClip, file: Path, headings: bool) -> None:
    body, few = Body(load_subject(clip.subject)), {"neighbours": 12, "rounds": 2, "survivors": 2, "headings": headings}
    pairs_alone = {"depth": {"squares": 0.0}}  # by squares this one is among the best
    changes = {"search": {"index": str(file)}, "elmo": few, "cues": pairs_alone}
    tracker = make_tracker("elmo", body, settings_for("elmo", changes=changes))
    (seen,) = depth_frames(clip, 1)
    state, _ = tracker.init(np.random.default_rng(0), seen)
    first = state.mixture.modes[0]
    other = replace(first, q=first.q.copy())
    half_turn = pin.SE3(pin.utils.rotate("z", np.pi), np.zeros(3))
    other.q[ROOT_Q] = pin.SE3ToXYZQUAT(pin.XYZQUATToSE3(first.q[ROOT_Q]) * half_turn)
    before = ElmoState(mixture_of((first, other), np.array([0.0, -8.0])), seen.time, seen.time)
    after, _ = tracker.step(np.random.default_rng(0), before, replace(seen, time=seen.time + 0.2))
    poses = np.array([mode.q for mode in after.mixture.modes])
    assert turned_round(body, poses, poses[0]).any() == headings


def test_a_frame_without_a_past_is_searched_from_more_poses(clip: RenderedClip, file: Path) -> None:
    few, frames, states = {"neighbours": 12, "rounds": 3, "survivors": 2, "limbs": 100}, list(depth_frames(clip, 2)), []
    first, second = [], []
    for anew in (1, 3):
        changes = {"search": {"index": str(file)}, "elmo": few | {"anew": anew}}
        tracker = make_tracker("elmo", Body(load_subject(clip.subject)), settings_for("elmo", changes=changes))
        states.append(tracker.init(np.random.default_rng(0), frames[0])[0])
        first.append(sum(tracker.search.steps))
        after, _ = tracker.step(np.random.default_rng(0), states[0], frames[1])
        second.append((sum(tracker.search.steps) - first[-1], after.mixture.modes[0].q.tobytes()))
    assert first[1] > 1.3 * first[0]
    assert second[0] == second[1]


def test_without_a_past_evidence_that_lasts_ranks_in_full() -> None:
    """What a likelihood leaves to frames without a past ranks candidates, and is in none of those that continue."""
    body = body_of("human34")
    poses = np.array([body.neutral, body.neutral])
    poses[1, 0] += 1.0
    start = Hypothesis(poses[0], 0, prior_score=-1.0)
    worse, better = (Candidate(start, q, body.landmarks(body.at(q)), e) for q, e in zip(poses, (5.0, 4.0), strict=True))

    class Likelihood(ImageLikelihood):
        def without_past(self, posed: PosedBody) -> float:
            return 3.0 * float(posed.q[0])

    case = FrameProblem((), 0.0, Likelihood())
    search = make_tracker("elmo", body, settings_for("elmo")).search
    for alone, expected in ((False, [better, worse]), (True, [worse, better])):
        assert [c.energy for c in _best(search, [worse, better], case, 2, alone)] == [c.energy for c in expected]
    assert _best(search, [better], case, 1, True)[0] is better
    assert [c.score for c in _in_full(search, [worse, better], case)] == [-6.0, -8.0]


def test_backs_pay_where_one_camera_sees_them(index: ExampleIndex) -> None:
    body = body_of("human34")
    facing = body.neutral.copy()
    facing[ROOT_Q] = pin.SE3ToXYZQUAT(pin.SE3(pin.utils.rotate("z", np.pi), np.zeros(3)))
    poses, nothing = np.array([facing, body.neutral]), np.zeros((SIDE, SIDE), np.uint8)
    none = index.nearest(np.zeros(bin_count(), np.uint16), 2)
    lookup = Lookup(0, ViewFrame(np.zeros(3), np.eye(3)), nothing, nothing > 0, none, poses)
    assert [h.prior_score for h in example_starts(body, [lookup], 3.0)] == [0.0, -3.0]
    assert [h.prior_score for h in example_starts(body, [lookup, lookup], 3.0)] == [0.0] * 4
    arm = body_of("arm8")  # whose root is fixed
    assert [h.prior_score for h in example_starts(arm, [lookup._replace(q=arm.neutral[None])], 3.0)] == [0.0]


def test_both_headings_are_tried_in_order_of_similarity(index: ExampleIndex) -> None:
    none = index.nearest(np.zeros(bin_count(), np.uint16), 8)
    lookup = Lookup(0, ViewFrame(np.zeros(3), np.eye(3)), np.zeros(0), np.zeros(0), none, np.arange(8.0)[:, None])
    away = np.array([True, True, True, True, True, False, True, False])
    assert either_way(lookup, away, 4).q[:, 0].tolist() == [0.0, 1.0, 5.0, 7.0]
    assert either_way(lookup, away, 6).q[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 5.0, 7.0]  # as many as exist
    assert either_way(lookup, ~away & False, 3).q[:, 0].tolist() == [0.0, 1.0, 2.0]
    assert either_way(lookup, away, 4).neighbours.numbers.tolist() == none.numbers[[0, 1, 5, 7]].tolist()
