"""Depth as a cue: which points are the person's, and their evidence on the pose."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial import cKDTree

import kinemode as km
from estimator.data.formats.cameras import load_cameras
from estimator.runs.run_reader import Run
from estimator.synthesis.settings import SceneSettings, ViewSettings
from estimator.vision.cues.depth import Depth, PersonPoints
from estimator.vision.cues.depth_person import nearest_thing
from estimator.vision.cues.depth_reading import (
    BACK,
    closest_nodes,
    closest_points,
    found_floor,
    spread_over,
    surface_precision,
)
from estimator.vision.cues.image_likelihood import ImageLikelihood, ImageModel
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from estimator.vision.stereo import DepthPoints
from humanoid.kinematics.body import Body, points_in_world
from humanoid.shape.surface import surface_of
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.explain import explain
from kinemode.shot import RenderedClip
from tests.tiny_clip import QUICK, named

UP = np.array([0.0, 0.0, 1.0])


def points_at(places: np.ndarray, noise: float = 0.01) -> DepthPoints:
    """Points as seen by a camera at the origin."""
    distance = np.linalg.norm(places, axis=1)
    return DepthPoints(places, places / distance[:, None], np.full(len(places), noise), distance / 300.0)


def box(centre: list[float], size: list[float], count: int, seed: int = 0) -> np.ndarray:
    return np.array(centre) + np.array(size) * (np.random.default_rng(seed).random((count, 3)) - 0.5)


def test_the_floor_is_found_below_what_stands_on_it() -> None:
    rng = np.random.default_rng(1)
    tilted = np.array([0.05, -0.03, 1.0]) / np.linalg.norm([0.05, -0.03, 1.0])
    plane = np.column_stack([rng.uniform(1.0, 5.0, 800), rng.uniform(-2.0, 2.0, 800), np.zeros(800)])
    plane[:, 2] = (-1.2 - plane @ tilted) / tilted[2]
    noisy = plane + 0.02 * rng.standard_normal((800, 1)) * tilted
    person = box([2.5, 0.0, -0.3], [0.4, 0.6, 1.6], 500)
    wall = box([5.0, 0.0, 0.3], [0.1, 4.0, 3.0], 700)
    places = np.concatenate([noisy, person, wall])
    floor = found_floor(places, np.full(len(places), 0.02), UP, rng)
    assert floor is not None
    assert np.degrees(np.arccos(floor.normal @ tilted)) < 1.0
    assert floor.offset == pytest.approx(-1.2, abs=0.03)
    assert found_floor(wall, np.full(700, 0.02), UP, rng) is None  # steep
    table = np.concatenate([noisy + 0.8 * UP, noisy])  # half of the points are far below it
    floor = found_floor(table, np.full(1600, 0.02), UP, rng)
    assert floor is not None
    assert floor.offset == pytest.approx(-1.2, abs=0.03)
    assert found_floor(np.zeros((2, 3)), np.zeros(2), UP, rng) is None


@pytest.mark.parametrize("seed", range(4))
def test_a_screen_before_all_most_of_the_time_does_not_hide_the_floor(seed: int) -> None:
    """An occluder in the frames from which a scene is learned: most points, and all of them above the floor."""
    rng = np.random.default_rng(seed)
    floor = np.column_stack([rng.uniform(1.0, 5.0, 400), rng.uniform(-2.0, 2.0, 400), 0.02 * rng.standard_normal(400)])
    wall = box([5.0, 0.0, 1.5], [0.1, 4.0, 3.0], 1200)
    screen = box([0.8, 0.0, 1.3], [0.01, 1.0, 0.8], 4000)
    places = np.concatenate([floor, wall, screen])
    level = found_floor(places, np.full(len(places), 0.02), UP, rng)
    assert level is not None
    assert np.degrees(np.arccos(level.normal @ UP)) < 1.5
    assert level.offset == pytest.approx(0.0, abs=0.03)


def test_the_nearest_thing_as_large_as_a_person_is_chosen() -> None:
    things = {
        "ball": box([1.0, 0.6, 0.0], [0.1, 0.1, 0.1], 100),
        "person": box([2.5, 0.0, 0.0], [0.3, 0.5, 1.7], 1500),
        "hand": box([2.15, 0.1, 0.2], [0.08, 0.08, 0.08], 60),  # before the trunk
        "behind": box([4.0, 0.3, 0.0], [0.3, 0.5, 1.7], 1500),
        "wall": box([1.5, 0.0, 3.0], [0.1, 6.0, 2.0], 6000),
    }
    places = np.concatenate(list(things.values()))
    area = np.full(len(places), 4e-4)
    mine = nearest_thing(points_at(places), area, UP, 0.1)
    ends = np.cumsum([len(each) for each in things.values()])
    shares = {name: part.mean() for name, part in zip(things, np.split(mine, ends[:-1]), strict=True)}
    assert shares == {"ball": 0.0, "person": 1.0, "hand": 1.0, "behind": 0.0, "wall": 0.0}
    assert not nearest_thing(points_at(things["wall"]), np.full(6000, 4e-4), UP, 0.1).any()
    np.testing.assert_array_equal(nearest_thing(points_at(places), area, UP, 0.1, pixels=4000), mine)
    assert not nearest_thing(points_at(places), area, UP, 0.1, pixels=2000).any()  # a person never fills the picture
    assert not nearest_thing(points_at(np.zeros((0, 3))), np.zeros(0), UP, 0.1).any()


def test_points_at_jumps_of_the_depth_join_nothing() -> None:
    """A person and a cupboard behind them, with a slope of points between, as block matching makes it."""
    person, cupboard = box([2.5, 0.0, 0.0], [0.3, 0.5, 1.7], 1500), box([3.4, 0.7, 0.0], [0.3, 0.5, 1.7], 1500, 1)
    along = np.linspace(0.0, 1.0, 60)[:, None]
    slope = person[:1] * [0, 0, 1] + (1.0 - along) * [2.5, 0.2, 0.0] + along * [3.4, 0.5, 0.0]
    places, area = np.concatenate([person, cupboard, slope]), np.full(3060, 4e-4)
    between = np.arange(3060) >= 3000
    assert nearest_thing(points_at(places), area, UP, 0.1)[1500:3000].all()
    mine = nearest_thing(points_at(places), area, UP, 0.1, between)
    assert mine[:1500].all()
    assert not mine[1500:3000].any()
    assert 0 < mine[3000:].sum() < 40  # the part of the slope that touches the person


def test_moving_takes_precedence_over_nearer() -> None:
    chair, person = box([1.5, 0.4, 0.0], [0.4, 0.4, 0.9], 1000), box([3.0, 0.0, 0.0], [0.3, 0.5, 1.7], 1500, 1)
    places, area = np.concatenate([chair, person]), np.full(2500, 4e-4)
    still, moved = np.zeros(2500, dtype=bool), np.arange(2500) >= 2000  # a third of the person
    for known, mine in ((still, slice(0, 1000)), (moved, slice(1000, 2500))):
        chosen = nearest_thing(points_at(places), area, UP, 0.1, None, known)
        assert chosen[mine].all()
        assert chosen.sum() == mine.stop - mine.start


def test_a_moving_part_some_way_off_is_the_person_s_and_a_moving_piece_is_a_person() -> None:
    """A raised leg hides the hip: trunk and standing leg have nothing between them, and seen from the side neither is
    large."""
    trunk, leg = box([3.0, 0.0, 0.5], [0.2, 0.2, 0.5], 130), box([3.0, 0.0, -0.25], [0.15, 0.15, 0.4], 80, 1)
    cupboard = box([1.5, 0.9, 0.0], [0.4, 0.4, 0.9], 1000, 2)
    places, area = np.concatenate([trunk, leg, cupboard]), np.full(1210, 4e-4)
    person = np.arange(1210) < 210
    np.testing.assert_array_equal(nearest_thing(points_at(places), area, UP, 0.1, None, person), person)
    known = nearest_thing(points_at(places), area, UP, 0.1, None, np.zeros(1210, dtype=bool))
    np.testing.assert_array_equal(known, ~person)  # nothing moves: the pieces are too small


def test_nodes_and_points_are_paired_with_the_closest_of_the_others() -> None:
    rng = np.random.default_rng(7)
    points, places = points_at(rng.uniform(1.0, 3.0, (900, 3))), rng.uniform(1.0, 3.0, (60, 3))
    nodes = rng.permutation(200)[:60]
    there = closest_points(points, places, nodes)
    np.testing.assert_array_equal(there.node, nodes)
    np.testing.assert_array_equal(there.point, cKDTree(points.places).query(places)[1])
    back = closest_nodes(points, places, nodes)
    assert len(set(back.point)) == BACK
    np.testing.assert_array_equal(back.node, nodes[cKDTree(places).query(points.places[back.point])[1]])


def test_precision_is_the_surface_s_across_and_loose_along_it() -> None:
    rng = np.random.default_rng(2)
    normals = rng.standard_normal((50, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    points = points_at(rng.uniform(1.0, 3.0, (50, 3)), 0.03)
    precision = surface_precision(points, normals, 0.02, 0.1)
    variance = np.array([
        n @ (a**2 * np.eye(3) + (b**2 - a**2) * np.outer(r, r)) @ n + 0.02**2
        for n, r, a, b in zip(normals, points.rays, points.across, points.along, strict=True)
    ])  # fmt: skip
    np.testing.assert_allclose(np.einsum("pi,pij,pj->p", normals, precision, normals), 1.0 / variance, rtol=1e-9)
    along = np.cross(normals, rng.standard_normal((50, 3)))
    along /= np.linalg.norm(along, axis=1)[:, None]
    np.testing.assert_allclose(np.einsum("pij,pj->pi", precision, along), along / 0.1**2, atol=1e-6)
    assert np.linalg.eigvalsh(precision).min() > 0.0


def test_some_of_many_are_spread_evenly() -> None:
    assert spread_over(3, 5).tolist() == [0, 1, 2]
    for count, most in ((1000, 400), (401, 400), (7, 3)):
        chosen = spread_over(count, most)
        assert len(np.unique(chosen)) == most
        assert (chosen[0], chosen[-1]) == (0, count - 1)
        assert np.ptp(np.diff(chosen)) <= 1


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> RenderedClip:
    """Four frames of a stereo pair, with exact depth."""
    return km.render(
        tmp_path_factory.mktemp("pair"), "reach", scene=SceneSettings(background="textured"), fps=5.0, seconds=0.8,
        view=ViewSettings(image_size=(320, 240), baseline=0.12), masks=True, depths=True,
    )  # fmt: skip


def reader(clip: RenderedClip, *, stereo: bool, cues: tuple[str, ...] = ("depth",)) -> CueReader:
    cameras = load_cameras(clip.cameras)
    given: dict[str, Any] = {"rights": [1, None]} if stereo else {"depths": list(clip.depths.values())}
    return CueReader(list(clip.videos.values()), list(cameras.values()), cue_settings(cues), **given)


@pytest.mark.parametrize(("stereo", "off"), [(False, 0.012), (True, 0.05)])
def test_points_lie_on_the_person(pair: RenderedClip, stereo: bool, off: float) -> None:
    body, q = Body(load_subject(pair.subject)), np.load(pair.truth)["q"]
    surface = surface_of(body, nodes=20_000)
    cues = reader(pair, stereo=stereo)
    for instant in (0, 3):
        seen: PersonPoints = cues.at(instant)[0][Depth.name]
        true = cKDTree(points_in_world(body.at(q[instant]), surface.joint, surface.local))
        distance = true.query(seen.points.places)[0]
        assert np.median(distance) < off
        assert np.mean(distance < 3.0 * seen.points.along + 0.02) > 0.95
        mask = cv2.imread(str(pair.masks["cam01"] / f"{instant:05d}.png"), cv2.IMREAD_GRAYSCALE) > 0
        x, y = np.round(seen.pixels).astype(int).T
        assert mask[y, x].mean() > (0.8 if stereo else 0.97)
        assert len(x) * seen.rays.step**2 > 0.75 * mask.sum()
    if stereo:
        assert Depth.name not in cues.at(0)[1]
    cues.close()


@pytest.mark.parametrize("stereo", [False, pytest.param(True, marks=pytest.mark.thorough)])
def test_the_silhouette_comes_from_depth_without_a_background(pair: RenderedClip, stereo: bool) -> None:
    """A person who hardly moves, in four frames: no background can be learned from the pictures alone."""
    cues = reader(pair, stereo=stereo, cues=("depth", "silhouette"))
    for instant in (3, 0):
        seen = cues.at(instant)[0]
        mask = cv2.imread(str(pair.masks["cam01"] / f"{instant:05d}.png"), cv2.IMREAD_GRAYSCALE) > 0
        silhouette = seen["silhouette"].mask
        assert np.count_nonzero(silhouette & mask) / np.count_nonzero(silhouette | mask) > (0.7 if stereo else 0.9)
    cues.close()


def test_the_true_pose_has_less_energy_and_agrees_more(pair: RenderedClip) -> None:
    body, q = Body(load_subject(pair.subject)), np.load(pair.truth)["q"][2]
    cues = reader(pair, stereo=False)
    read = cues.at(2)[:1]
    likelihood = ImageLikelihood.of(ImageModel(body), read, [60.0])
    cues.close()
    rng = np.random.default_rng(3)
    true, agreed = sum(likelihood.assigned_values(body.at(q))), likelihood.agreement(body.at(q))[0]
    assert agreed > 0.85
    for _ in range(5):
        other = body.at(body.integrate(q, 0.25 * rng.uniform(-1.0, 1.0, body.nv)))
        assert sum(likelihood.assigned_values(other)) > true
        assert likelihood.agreement(other)[0] < agreed
    beside = q.copy()
    beside[:2] += 10.0  # m, out of the picture
    assert sum(likelihood.assigned_values(body.at(beside))) > 2.0 * true


@pytest.mark.paper
def test_a_body_is_tracked_by_depth_and_explained(clip: RenderedClip, tmp_path: Path) -> None:
    run = km.track(clip.subject, **named(clip), depth=clip.depths, cues="depth", settings=QUICK, out=tmp_path / "a.run")
    assert run.header.cues == ("depth",)
    assert run.header.depths == {"cam01": str(clip.depths["cam01"])}
    errors = km.evaluate(run, clip.truth)
    assert errors.mpjpe < 0.06
    explained = explain(Run.open(tmp_path / "a.run"), 2)
    assert any(part.name == "depth" for part in explained.parts)
    quick = {**QUICK, "smooth": {"enabled": False}}
    again = km.track(clip.subject, **named(clip), depth=clip.depths, settings=quick)  # all cues, as there is depth
    assert again.header.cues == ("edges", "flow", "silhouette", "depth")


def test_a_pair_is_explained_by_its_left_camera_as_the_run_has_it(pair: RenderedClip, tmp_path: Path) -> None:
    """The parts of the energy add up to what is stored: the right picture, which only gives depth, has none."""
    out = tmp_path / "a.run"
    km.track(
        pair.subject, clips=pair.videos, cameras=pair.cameras, keypoints=pair.first_frame, cues="depth", fit="off",
        stereo={"cam01": "cam01_right"}, settings=QUICK, end=0.3, out=out,
    )  # fmt: skip
    explained = explain(Run.open(out), 1)
    assert {part.camera for part in explained.parts if part.name == "depth"} == {"cam01"}
    assert sum(part.energy for part in explained.parts) == pytest.approx(explained.stored, abs=1e-6)


def test_invalid_depth_is_refused_before_any_work(clip: RenderedClip, pair: RenderedClip, tmp_path: Path) -> None:
    short = tmp_path / "short"
    short.mkdir()
    (short / "0.png").write_bytes((clip.depths["cam01"] / "00000.png").read_bytes())
    two = {"clips": pair.videos, "cameras": pair.cameras, "keypoints": pair.first_frame}
    cases: list[tuple[dict[str, Any], str]] = [
        ({"cues": "depth"}, "cues: depth needs depth, and none is given .*--stereo.*--depth"),
        ({"cues": "edges", "depth": clip.depths}, "depth: is for the cue depth, which is not used"),
        ({"depth": short}, "has depth pictures of 1 frames, the clip has 5"),
        ({"depth": tmp_path / "none"}, "no such depth folder"),
        ({"depth": pair.depths["cam01"]}, "not 160 x 120 as the camera's"),
        ({"stereo": "cam01=cam02"}, "there is no camera 'cam02' .*cameras with clips: cam01"),
        ({**two, "stereo": "cam01"}, "--stereo cam01: is not a pair of cameras .*LEFT=RIGHT"),
        ({**two, "stereo": "cam01=cam01"}, "is one camera twice"),
        ({**two, "stereo": {"cam01_right": "cam01"}}, "stereo pair cam01_right=cam01: cam01 stands to the left"),
        (
            {**two, "stereo": "cam01=cam01_right", "offset": {"cam01_right": 0.1}},
            "--stereo cam01=cam01_right: their pictures are up to 100 ms apart",
        ),
        ({"stereo": 3}, "stereo"),
    ]
    for changes, message in cases:
        with pytest.raises(InputError, match=message):
            km.track(clip.subject, **{**named(clip), "out": tmp_path / "a.run", **changes})
    assert not (tmp_path / "a.run").exists()


def test_both_cameras_of_a_rendered_pair_see_the_same_surfaces(pair: RenderedClip) -> None:
    left, right = load_cameras(pair.cameras).values()
    assert np.linalg.norm(right.centre_world - left.centre_world) == pytest.approx(0.12)
    np.testing.assert_allclose((right.centre_world - left.centre_world) / 0.12, left.R_camera_world[0], atol=1e-9)
    with pytest.raises(InputError, match="baseline"):
        ViewSettings(baseline=-0.1)
