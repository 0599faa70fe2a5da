"""What the rays of a depth picture contradict: known answers before a wall, and laws of the energy of a pose."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import kinemode as km
from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras import load_cameras
from estimator.data.image_cues import ImageCues
from estimator.synthesis.settings import ViewSettings
from estimator.vision.cues.depth_rays import NOTHING, DepthRays, depth_behind, one_a_square
from estimator.vision.cues.depth_reading import DepthSettings
from estimator.vision.cues.image_likelihood import ImageLikelihood, ImageModel
from estimator.vision.cues.reader import CueReader
from estimator.vision.cues.settings import cue_settings
from estimator.vision.prediction import Prediction, Predictor
from estimator.vision.stereo import DepthMap
from humanoid.kinematics.body import Body
from humanoid.shape.surface import surface_of
from humanoid.subject.subject import load_subject

K = np.array([[60.0, 0.0, 31.5], [0.0, 60.0, 23.5], [0.0, 0.0, 1.0]])
CAMERA = Camera("ahead", (64, 48), K, np.zeros(5), np.eye(3), np.zeros(3))  # looks along z
RAYS, SQUARES = "what rays contradict", "depth in squares"
MOST = 5.0  # nats


def before_a_wall() -> DepthRays:
    """A person as a board of 10 columns, 2 m away, before a wall 4 m away; a strip beside it is unknown."""
    depth = np.full((48, 64), 4.0)
    depth[:, 20:30] = 2.0
    depth[:, 32:34] = np.nan
    rows, columns = (x.ravel() for x in np.mgrid[0:48:2, 0:64:2])
    jumps = np.isin(columns, (28, 30))
    mine = np.flatnonzero((columns >= 20) & (columns < 30))
    seen, pixels = DepthMap(CAMERA, depth, 0.002), np.stack([columns, rows], axis=1).astype(float)
    person = seen.points(rows[mine], columns[mine], CAMERA.directions(pixels[mine]))
    return DepthRays.of(seen, rows, columns, 2, jumps, person, mine)


def place(column: float, row: float, depth: float) -> np.ndarray:
    return depth * (np.linalg.inv(K) @ [column, row, 1.0])


def test_what_the_camera_sees_past_is_contradicted() -> None:
    rays = before_a_wall()
    cases = {
        "on the person": (place(22, 20, 2.01), False, False),
        "behind the person's surface": (place(22, 20, 2.6), False, False),
        "before the person's surface": (place(22, 20, 1.7), True, True),
        "in the air before the wall": (place(50, 20, 2.0), True, False),
        "at the wall": (place(50, 20, 3.98), False, False),
        "beside a jump": (place(28, 20, 1.5), False, False),
        "where depth is unknown": (place(32, 20, 1.5), False, False),
        "out of the picture": (place(90, 20, 2.0), False, False),
    }
    places = np.array([case[0] for case in cases.values()])
    past = rays.seen_past(places, 0.02, 3.0, 8.0)
    expected = [k for k, case in enumerate(cases.values()) if case[1]]
    assert past.place.tolist() == expected
    on_person = [case[2] for case in cases.values() if case[1]]
    assert (past.point != NOTHING).tolist() == on_person
    np.testing.assert_allclose(rays.surface.places[past.point[0]], place(22, 20, 2.0), atol=1e-6)


def test_a_square_of_the_picture_counts_once_however_many_places_are_in_it() -> None:
    rays = before_a_wall()
    many = np.array([place(column, row, 1.5) for column in (1, 3, 5, 40) for row in (1, 3)])
    past = rays.seen_past(many, 0.02, 3.0, 8.0)
    assert len(past.place) == len(many)
    assert past.weight.sum() == pytest.approx(2.0)
    within = np.array([place(1, 1, 1.5), place(3, 3, 3.99)])  # one of two in a square
    np.testing.assert_allclose(rays.seen_past(within, 0.02, 3.0, 8.0).weight, [0.5])
    assert rays.share(8.0) * 16 == pytest.approx(1.0)
    np.testing.assert_allclose(one_a_square(np.array([[0, 1], [1, 0], [0, 1], [1, 1]])), [0.5, 1.0, 0.5, 1.0])


def energy_before_a_wall(depth: np.ndarray) -> float:
    """Of a body with a depth (48, 64) [m] in every pixel, infinite where it is not; its surface is known to 20 mm, the
    mean of a square of the board to 4 mm."""
    body = dict.fromkeys(Prediction._fields, np.zeros(0)) | {"buffer": 1.0 / depth, "frame": np.array([0.0, 0.0, 1.0])}
    return before_a_wall().squares_energy(Prediction(**body), 0.02, 8.0, 0.5, 3.0, MOST)


def test_squares_cost_what_depth_in_them_is_off() -> None:
    nowhere, columns = np.full((48, 64), np.inf), np.arange(64)
    board = np.where((columns >= 20) & (columns < 28), 2.0, nowhere)
    squares = 4 * 24 / 16  # of the board without its edge, on a grid of every second pixel
    assert energy_before_a_wall(board) == pytest.approx(0.0, abs=1e-9)
    assert energy_before_a_wall(nowhere) == pytest.approx(MOST * squares)
    assert energy_before_a_wall(board - 0.5) == pytest.approx(MOST * squares, rel=0.01)
    std = np.hypot(0.02, 0.5 * 0.002 * 2.0**2)
    assert energy_before_a_wall(board + 2.0 * std) == pytest.approx(2.0 * squares, rel=0.03)
    waves = std * np.where(columns % 4 < 2, 3.0, -3.0)  # errors of both signs in every square
    assert energy_before_a_wall(board + waves) == pytest.approx(0.0, abs=1e-9)
    beside = np.where((columns >= 48) & (columns < 56), 2.0, board)  # an arm where the wall is seen
    assert energy_before_a_wall(beside) == pytest.approx(MOST * squares)
    behind, unknown = np.where(columns >= 48, 5.0, board), np.where((columns >= 30) & (columns < 34), 1.0, board)
    assert energy_before_a_wall(behind) == energy_before_a_wall(unknown) == pytest.approx(0.0, abs=1e-9)


def test_how_far_the_body_is_behind_a_place() -> None:
    body = Body(load_subject("human34"))
    surface, q = surface_of(body, nodes=4000), body.neutral.copy()
    R = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    camera = Camera("ahead", (320, 240), np.diag([300.0, 300.0, 1.0]) + np.array([[0, 0, 160], [0, 0, 120], [0, 0, 0]]),
                    np.zeros(5), R, R @ -np.array([-3.0, 0.0, 0.0]))  # fmt: skip
    prediction = Predictor(surface, camera).predict(body.at(q))
    seen = np.flatnonzero(prediction.visible)
    pixels, depth = prediction.pixels[seen], prediction.depth[seen]
    places = camera.centre_world + (camera.directions(pixels) * (depth - 0.2)[:, None]) @ camera.R_camera_world
    assert np.median(depth_behind(camera, places, prediction)) == pytest.approx(0.2, abs=0.01)
    aside = places + np.array([0.0, 3.0, 0.0])
    assert np.isinf(depth_behind(camera, aside, prediction)).all()


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> tuple[Body, np.ndarray, ImageCues]:
    """A body, its pose (nq,) and what exact depth shows of it."""
    clip = km.render(
        tmp_path_factory.mktemp("depth"), "reach", fps=5.0, seconds=0.4, depths=True,
        view=ViewSettings(image_size=(320, 240)),
    )  # fmt: skip
    cameras = list(load_cameras(clip.cameras).values())
    reader = CueReader(list(clip.videos.values()), cameras, cue_settings(("depth",)), depths=list(clip.depths.values()))
    read = reader.at(0)[0]
    reader.close()
    return Body(load_subject(Path(clip.subject))), np.load(clip.truth)["q"][0], read


def parts(seen: tuple[Body, np.ndarray, ImageCues], q: np.ndarray) -> dict[str, float]:
    """The energy of a pose by its terms' names, the two of depth summed."""
    body, _, read = seen
    (camera,) = ImageLikelihood.of(ImageModel(body), [read], [60.0]).cameras
    posed = body.at(q)
    values: dict[str, float] = {}
    prediction = camera.predictor.predict(posed)
    for term in camera.others(posed, prediction):
        values[term.name] = values.get(term.name, 0.0) + term.value(posed)
    for match in camera.contours(prediction):
        values[match.label] = match.unassigned
    return values


def test_rays_contradict_wrong_arms_and_not_the_true_pose(seen: tuple[Body, np.ndarray, ImageCues]) -> None:
    """An arm that lies elsewhere is seen past, and its own surface is left uncovered: several squares contradict it."""
    body, q, read = seen
    true = parts(seen, q)
    assert true.get(RAYS, 0.0) < 1.0
    for name in ("left_shoulder_flexion", "right_shoulder_flexion"):
        wrong = q.copy()
        wrong[body.q_names.index(name)] += 1.0
        contradicted = parts(seen, body.clamp(wrong))
        assert contradicted[RAYS] > true.get(RAYS, 0.0) + 3.0
        assert contradicted[SQUARES] > true[SQUARES] + 1.0
    (camera,) = ImageLikelihood.of(ImageModel(body), [read], [60.0]).cameras
    share = DepthSettings().repeated
    assert camera.without_past(body.at(q)) == pytest.approx(true[SQUARES] * (1.0 - share) / share)


def test_nobody_stands_in_the_floor(seen: tuple[Body, np.ndarray, ImageCues]) -> None:
    q = seen[1]
    sunk, raised = q.copy(), q.copy()
    sunk[2], raised[2] = q[2] - 0.1, q[2] + 0.1
    assert parts(seen, sunk)["depth"] > parts(seen, raised)["depth"] + 1.0
