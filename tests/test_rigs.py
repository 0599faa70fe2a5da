"""Cameras calibrated from a moving person."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builders import body_of
from scipy.spatial.transform import Rotation

import kinemode as km
import kinemode.__main__ as front
from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.data.rigs import calibrate, search
from estimator.data.rigs.bundle import RigProblem, RigRays, adjusted, bent, by_place, by_radial, straight
from estimator.data.rigs.calibrate import PersonCalibration, RigWorld, causes, in_words
from estimator.data.rigs.first import best_pairs, state_of_pair, triangulated
from estimator.data.rigs.lengths import SegmentLengths
from estimator.data.rigs.search import RigViews, exchanged, fitted_rig, with_exchanged
from estimator.data.rigs.views import JointView
from estimator.numerics.robust import typical_distance
from estimator.synthesis.detector import keypoints
from estimator.synthesis.motion import authored_motion
from estimator.synthesis.motion_keys import motion_named
from estimator.synthesis.settings import DetectorSettings, ViewSettings
from estimator.synthesis.views import framing_cameras
from estimator.vision.resolution import scaled_camera
from humanoid.kinematics.body import ROOT_PLACE_Q, Body
from humanoid.support.errors import InputError
from kinemode.inputs.lens import PHONES, PHONES_STD
from kinemode.inputs.load import load_inputs
from kinemode.request import FileOptions
from tests.quick_rigs import quick_rigs
from viz.pictures.rig_picture import ABOVE, ASIDE, rig_drawing

__all__ = ["quick_rigs"]

FPS = 15.0
QUIET = DetectorSettings(noise_px=1.0, outlier_fraction=0.0, missing_fraction=0.02)


def walked(body: Body, seconds: float = 6.0) -> np.ndarray:
    """Poses (T, nq) of a person who reaches out while walking to and fro."""
    times = np.arange(round(FPS * seconds)) / FPS
    keyed = motion_named("turn_reach")
    q = authored_motion(body, times * keyed.seconds / seconds, keyed)  # nothing repeats, so that clocks are determined
    q[:, ROOT_PLACE_Q.start] += 0.8 * np.sin(1.1 * times)
    q[:, ROOT_PLACE_Q.start + 1] += 0.6 * np.sin(0.7 * times + 1.0)
    return q


class Filmed:
    """A person before three cameras."""

    def __init__(self, errors: DetectorSettings = QUIET) -> None:
        self.body = body_of("human34")
        self.q = walked(self.body)
        self.points = self.body.landmarks_of(self.body.placed(self.q))
        view = ViewSettings(count=3, azimuth=20.0, fill=0.6, image_size=(1280, 720))
        self.cameras = {camera.name: camera for camera in framing_cameras(self.points, view)}
        rng = np.random.default_rng(1)
        tracks = keypoints(self.body, self.q, list(self.cameras.values()), rng, errors, fps=FPS)
        self.tracks = dict(zip(self.cameras, tracks, strict=True))

    @property
    def times(self) -> dict[str, np.ndarray]:
        return {name: np.arange(track.frame_count) / FPS for name, track in self.tracks.items()}

    def lost(self) -> dict[str, Camera]:
        """The cameras' lenses, with all of them at the origin."""
        return {n: replace(c, R_camera_world=np.eye(3), t_camera_world=np.zeros(3)) for n, c in self.cameras.items()}


@pytest.fixture(scope="module")
def filmed() -> Filmed:
    return Filmed()


def turns_off(rig: PersonCalibration, truth: dict[str, Camera]) -> np.ndarray:
    """Rotation errors of the cameras relative to the first [deg]."""
    first, true_first = next(iter(rig.cameras.values())), next(iter(truth.values()))
    off = []
    for name, camera in rig.cameras.items():
        R, R_true = camera.R_camera_world @ first.R_camera_world.T, None
        R_true = truth[name].R_camera_world @ true_first.R_camera_world.T
        off.append(np.degrees(np.arccos(np.clip((np.trace(R @ R_true.T) - 1.0) / 2.0, -1.0, 1.0))))
    return np.array(off)


def places_off(rig: PersonCalibration, truth: dict[str, Camera]) -> np.ndarray:
    """Position errors of the cameras relative to the first, scale removed, as a share of the distance to the person."""
    ours, theirs = (
        np.array([next(iter(of.values())).R_camera_world @ (c.centre_world - next(iter(of.values())).centre_world)
                  for c in of.values()])
        for of in (rig.cameras, truth)
    )  # fmt: skip
    scale = (ours * theirs).sum() / np.square(ours).sum()
    return np.asarray(np.linalg.norm(scale * ours - theirs, axis=1) / rig.distance)


def rays_of(filmed: Filmed, lengths: SegmentLengths) -> np.ndarray:
    """Exact rays (C, T, J, 2)."""
    points = filmed.points[:, lengths.landmark]
    return np.stack([c.directions(c.project(points))[..., :2] for c in filmed.cameras.values()])


def lengths_of(filmed: Filmed) -> SegmentLengths:
    return SegmentLengths.of(filmed.body, next(iter(filmed.tracks.values())).names)


def test_segments_keep_their_lengths_and_mirror_each_other(filmed: Filmed) -> None:
    lengths = lengths_of(filmed)
    names = [filmed.body.landmark_names[i] for i in lengths.landmark]
    pairs = {(names[a], names[b]) for a, b in zip(lengths.first, lengths.second, strict=True)}
    assert {("left_hip", "left_knee"), ("right_knee", "right_ankle"), ("left_elbow", "left_wrist")} <= pairs
    assert not any({"nose", "left_eye"} & set(pair) for pair in pairs)
    points = filmed.points[:, lengths.landmark]
    apart = np.linalg.norm(points[:, lengths.first] - points[:, lengths.second], axis=2)
    assert np.all(np.abs(apart.mean(axis=0) - lengths.mean) < 0.02 + 2.0 * lengths.slack)
    for a, b in zip(lengths.left, lengths.right, strict=True):
        mirrored = sorted(lengths.mirror[[lengths.first[a], lengths.second[a]]].tolist())
        assert mirrored == [lengths.first[b], lengths.second[b]]


def test_derivatives_are_those_of_the_residuals(filmed: Filmed) -> None:
    lengths = lengths_of(filmed)
    rays = rays_of(filmed, lengths)[:, ::10]
    std = np.full((len(rays), rays.shape[2]), 0.01)
    pose, _ = best_pairs(rays, lengths.mirror, std, 1)[0]
    state = state_of_pair(rays, pose, std, lengths)
    assert state is not None
    focal, radial = np.array([0.0, 0.1, 0.1]), np.array([0.1, 0.0, 0.1])
    seen = RigRays(rays, np.full(rays.shape, 0.1), std, focal, radial, np.array([0.0, 0.05, 0.0]))
    problem = RigProblem(state, seen, lengths)
    rng = np.random.default_rng(0)
    x = problem.start + 0.02 * rng.normal(size=len(problem.start))
    x[[0, 1, 2, 6, 7, 8]] += 0.2 * rng.normal(size=6)  # large turns
    J, step = problem.jacobian(x).toarray(), 1e-6
    for i in rng.choice(len(x), 60, replace=False).tolist() + list(range(18)):
        d = step * np.eye(len(x))[i]
        slope = (problem.residuals(x + d) - problem.residuals(x - d)) / (2.0 * step)
        np.testing.assert_allclose(J[:, i], slope, atol=1e-5 * max(1.0, np.abs(slope).max()))


def test_exact_rays_give_the_rig_back(filmed: Filmed) -> None:
    lengths = lengths_of(filmed)
    rays = rays_of(filmed, lengths)[:, ::3]
    std = np.full((len(rays), rays.shape[2]), 0.002)
    pose, other = best_pairs(rays, lengths.mirror, std, 1)[0]
    assert not other
    state = state_of_pair(rays, pose, std, lengths)
    assert state is not None
    cameras = list(filmed.cameras.values())
    for c, camera in enumerate(cameras):
        R = camera.R_camera_world @ cameras[0].R_camera_world.T
        np.testing.assert_allclose(state.R[c], R, atol=2e-3)
    points = triangulated(rays, state.R, state.t, range(3))
    assert np.isfinite(points).all()
    seen = RigRays(rays, np.zeros_like(rays), std, np.zeros(3), np.zeros(3), np.zeros(3))
    result = adjusted(state, seen, lengths)
    assert result.cost <= adjusted(state, seen, lengths, most=1).cost
    for c, camera in enumerate(cameras):
        R = camera.R_camera_world @ cameras[0].R_camera_world.T
        np.testing.assert_allclose(result.state.R[c], R, atol=5e-3)


def test_a_lens_and_its_derivatives() -> None:
    rng = np.random.default_rng(0)
    x, focal, radial = 0.5 * rng.normal(size=(40, 2)), rng.uniform(0.8, 1.2, 40), rng.uniform(-0.1, 0.3, 40)
    x[0] = np.nan
    np.testing.assert_allclose(straight(bent(x, focal, radial), focal, radial), x, atol=1e-9)
    for i, d in enumerate(1e-6 * np.eye(2)):
        slope = (bent(x + d, focal, radial) - bent(x - d, focal, radial)) / 2e-6
        np.testing.assert_allclose(by_place(x, focal, radial)[..., i], slope, atol=1e-8)
    np.testing.assert_allclose(bent(x, focal, radial + 1.0) - bent(x, focal, radial), by_radial(x, focal), atol=1e-12)
    far = straight(np.array([[1e9, 0.0]]), np.ones(1), np.array([-0.1]))  # beyond where the picture folds
    assert np.isfinite(far).all()


@pytest.mark.parametrize("noise", [1e-3, 1e-2])
def test_a_radial_term_is_fitted_where_the_motion_shows_it(filmed: Filmed, noise: float) -> None:
    """At close range, where the person reaches the borders of a wide lens."""
    lengths, middle, rng = lengths_of(filmed), filmed.points.mean(axis=(0, 1)), np.random.default_rng(3)
    names, points = [filmed.body.landmark_names[i] for i in lengths.landmark], filmed.points[:, lengths.landmark]
    k, views = -0.1, []
    for camera in filmed.cameras.values():
        near = middle + 0.45 * (camera.centre_world - middle)
        rays = (points - near) @ camera.R_camera_world.T
        seen = bent(rays[..., :2] / rays[..., 2:], np.ones(1), np.array(k))
        seen += noise * rng.normal(size=seen.shape)
        lens = replace(filmed.lost()[camera.name], distortion=np.zeros(5), focal_std=0.1)
        views.append(JointView(lens, seen @ lens.K[:2, :2].T + lens.K[:2, 2], filmed.times[camera.name]))
    views_given = RigViews.of(views, names, clocks_known=True)
    fit = fitted_rig(views_given, lengths, [np.zeros(3)])
    assert fit is not None
    if noise < 5e-3:
        np.testing.assert_allclose(fit.state.radial, k, atol=0.01)
        assert np.all(fit.unsure.radial_std > 0.0)
    else:
        assert np.all(fit.state.radial == 0.0)


def test_frames_with_exchanged_sides_are_found(filmed: Filmed) -> None:
    lengths = lengths_of(filmed)
    rays = rays_of(filmed, lengths)
    std = np.full((len(rays), rays.shape[2]), 0.004)
    flips = np.zeros(rays.shape[:2], dtype=bool)
    flips[1, 10:30] = True
    pose, _ = best_pairs(rays, lengths.mirror, std, 1)[0]
    state = state_of_pair(rays, pose, std, lengths)
    assert state is not None
    wrong = with_exchanged(rays, flips, lengths.mirror)
    np.testing.assert_array_equal(exchanged(state, wrong, std, lengths.mirror), flips)


def test_a_person_places_the_cameras(filmed: Filmed) -> None:
    rig = calibrate.calibrate_by_person(filmed.body, filmed.tracks, filmed.lost(), filmed.times, clocks_known=True)
    assert turns_off(rig, filmed.cameras).max() < 1.0
    assert places_off(rig, filmed.cameras).max() < 0.03
    assert max(rig.turn_stds.values()) < 3.0
    assert rig.turn_stds["cam01"] == 0.0
    assert not rig.doubtful
    assert rig.offsets == dict.fromkeys(filmed.cameras, 0.0)
    upright = next(iter(rig.cameras.values())).R_camera_world @ [0.0, 0.0, 1.0]
    true = next(iter(filmed.cameras.values())).R_camera_world @ [0.0, 0.0, 1.0]
    assert np.degrees(np.arccos(upright @ true)) < 6.0
    assert all(camera.centre_world[2] > 0.5 for camera in rig.cameras.values())


def test_the_world_shows_what_the_rig_shows() -> None:
    rng = np.random.default_rng(3)
    R, R_world = Rotation.random(2, random_state=3).as_matrix()
    t, points = rng.normal(size=3), rng.normal(size=(5, 3))
    world = RigWorld(R_world, rng.normal(size=3), 1.2, "person")
    R_camera, t_camera = world.camera(R, t)
    np.testing.assert_allclose(world.points(points) @ R_camera.T + t_camera, 1.2 * (points @ R.T + t))


def test_clocks_are_found_with_the_cameras(filmed: Filmed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "_BEGINNINGS", 2)
    late = {"cam01": 0, "cam02": 9, "cam03": 4}
    tracks = {
        name: replace(track, pixels=track.pixels[late[name] :], confidence=track.confidence[late[name] :])
        for name, track in filmed.tracks.items()
    }
    times = {name: np.arange(track.frame_count) / FPS for name, track in tracks.items()}
    rig = calibrate.calibrate_by_person(filmed.body, tracks, filmed.lost(), times)
    for name, frames in late.items():
        assert rig.offsets[name] * FPS == pytest.approx(frames, abs=0.6)
    assert turns_off(rig, filmed.cameras).max() < 1.5


def test_focal_lengths_are_found_where_they_are_guessed(filmed: Filmed) -> None:
    lenses = {}
    for name, lens in filmed.lost().items():
        K = lens.K.copy()
        K[:2, :2] *= 0.9
        lenses[name] = replace(lens, K=K, focal_std=0.1)
    rig = calibrate.calibrate_by_person(filmed.body, filmed.tracks, lenses, filmed.times, clocks_known=True)
    for name, camera in rig.cameras.items():
        assert camera.K[0, 0] == pytest.approx(filmed.cameras[name].K[0, 0], rel=0.06)
        assert any(name in note and "focal length" in note for note in rig.notes)


def hidden(track: KeypointTrack) -> KeypointTrack:
    return replace(track, pixels=np.full_like(track.pixels, np.nan), confidence=np.zeros_like(track.confidence))


def test_uninformative_views_are_refused(filmed: Filmed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "_BEGINNINGS", 1)
    alone = {"cam01": filmed.tracks["cam01"]}
    with pytest.raises(InputError, match="there is one"):
        calibrate.calibrate_by_person(filmed.body, alone, filmed.lost(), filmed.times, clocks_known=True)
    unseen = {**filmed.tracks, "cam02": hidden(filmed.tracks["cam02"])}
    with pytest.raises(InputError, match="no person is seen by cam02"):
        calibrate.calibrate_by_person(filmed.body, unseen, filmed.lost(), filmed.times, clocks_known=True)
    clicked = {n: replace(t, pixels=t.pixels[:1], confidence=t.confidence[:1]) for n, t in filmed.tracks.items()}
    instant = dict.fromkeys(clicked, np.zeros(1))
    for known in (True, False):
        with pytest.raises(InputError, match="no two of cam01"):
            calibrate.calibrate_by_person(filmed.body, clicked, filmed.lost(), instant, clocks_known=known)
    few = {name: replace(track, names=(None,) * 14 + track.names[14:]) for name, track in filmed.tracks.items()}
    with pytest.raises(InputError, match="no two of cam01"):
        calibrate.calibrate_by_person(filmed.body, few, filmed.lost(), filmed.times, clocks_known=True)
    still = {
        name: replace(track, pixels=np.tile(track.pixels[:1], (len(track.pixels), 1, 1)))
        for name, track in filmed.tracks.items()
    }
    with pytest.raises(InputError, match=r"started is not certain|does not determine"):
        calibrate.calibrate_by_person(filmed.body, still, filmed.lost(), filmed.times)


def made_rig(cameras: Sequence[Camera], residuals: np.ndarray) -> PersonCalibration:
    """The rig of these cameras, the last one's place uncertain, and a standing person; residuals (T, J, 2) [px]."""
    names, zero = [camera.name for camera in cameras], dict.fromkeys((camera.name for camera in cameras), 0.0)
    points = np.tile([[0.0, 0.1, 0.9], [0.0, -0.1, 0.9], [0.0, 0.1, 0.5]], (len(residuals), 1, 1))
    unsure = replace(cameras[-1], deviations=0.25 * np.eye(7)[:, 3:4])
    return PersonCalibration(
        cameras=dict(zip(names, [*cameras[:-1], unsure], strict=True)),
        offsets=zero, offset_stds=zero, radial_stds=zero, exchanged=zero,
        residuals=dict.fromkeys(names, residuals), names=("left_hip", "right_hip", "left_knee"),
        times=np.arange(len(points)) / FPS, points=points,
        notes=(),
    )  # fmt: skip


def test_errors_are_root_mean_squares_without_outliers() -> None:
    rng = np.random.default_rng(0)
    residuals = 3.0 * rng.normal(size=(4000, 3, 2))
    residuals[:3], residuals[3:6] = 1e4, np.nan
    rig = made_rig([Camera("a", (640, 480), np.eye(3), np.zeros(5), np.eye(3), np.zeros(3))], residuals)
    assert rig.errors["a"] == pytest.approx(3.0 * np.sqrt(2.0), rel=0.03)
    assert np.isnan(typical_distance(rig.distances["a"], axis=1)[3])


def test_the_picture_shows_cameras_where_they_stand(filmed: Filmed) -> None:
    """To scale, with their deviations; names neither over each other nor cut off, also of cameras side by side."""
    beside = [
        replace(camera, name=f"{camera.name} beside", t_camera_world=camera.t_camera_world + 0.06)
        for camera in filmed.cameras.values()
    ]
    cameras = [*filmed.cameras.values(), *beside]
    drawing = rig_drawing(made_rig(cameras, np.ones((4, 3, 2))))
    above, side, _, _ = drawing.axes
    for axes, seen in ((above, ABOVE), (side, ASIDE)):
        marks = {line.get_gid(): line.get_xydata()[0] for line in axes.lines if line.get_gid()}
        for camera in cameras:
            np.testing.assert_allclose(marks[f"camera {camera.name}"], camera.centre_world[list(seen)])
        (disc,) = axes.patches[-1:]
        assert disc.get_radius() == 0.25
        np.testing.assert_allclose(disc.get_center(), cameras[-1].centre_world[list(seen)])
        boxes = [text.get_window_extent().extents for text in axes.texts]
        assert len(boxes) == len(cameras)
        for a, b in combinations(boxes, 2):
            assert np.any(a[:2] >= b[2:]) or np.any(b[:2] >= a[2:])
        assert all(np.all(axes.bbox.extents[:2] <= b[:2]) and np.all(b[2:] <= axes.bbox.extents[2:]) for b in boxes)
    assert above.get_aspect() == 1.0


@pytest.fixture(scope="module")
def keypoint_files(filmed: Filmed, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("keypoints")
    files = {name: folder / f"{name}.json" for name in filmed.tracks}
    for name, path in files.items():
        write_keypoints(path, filmed.tracks[name])
    return files


def test_cameras_are_found_from_keypoint_files(
    filmed: Filmed, keypoint_files: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same by the function, the command and as the cameras of a track."""
    out, again = tmp_path / "cameras.json", tmp_path / "again.json"
    offset = [f"{name}=0" for name in keypoint_files]
    rig = km.calibrate_from_person(keypoints=keypoint_files, height=1.8, offset=offset, out=out)
    assert turns_off(rig, filmed.cameras).max() < 3.0
    written = km.load_cameras(out)
    for name, camera in rig.cameras.items():
        np.testing.assert_allclose(written[name].R_camera_world, camera.R_camera_world, atol=1e-6)
        np.testing.assert_allclose(written[name].K, camera.K, rtol=1e-6)
    files = [f"{name}={path}" for name, path in keypoint_files.items()]
    line = ["calibrate", "--from-person", "--keypoints", *files, "--height", "1.8", "--offset", *offset]
    drawn = tmp_path / "rig.png"
    assert front.main([*line, "--out", str(again), "--picture", str(drawn)]) == 0
    assert drawn.read_bytes().startswith(b"\x89PNG")
    assert again.read_text(encoding="utf-8") == out.read_text(encoding="utf-8")
    printed = capsys.readouterr().out.replace("\n", "")
    assert f"--cameras {again}" in printed
    assert f"picture written to {drawn}" in printed
    options = FileOptions(None, keypoints=keypoint_files, cameras=Path("auto"), offset=offset, height=1.8)
    inputs = load_inputs(filmed.body, options)
    for camera in inputs.observations[0].cameras:
        np.testing.assert_allclose(camera.R_camera_world, rig.cameras[camera.name].R_camera_world)
    assert any("found from the person" in note for note in inputs.notes)
    assert inputs.R_upright_given is None


@pytest.fixture(scope="module")
def lens_files(filmed: Filmed, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Calibrations of pictures of half the size, all at the origin: of every camera, of two, and of one."""
    folder = tmp_path_factory.mktemp("lenses")
    lost = [scaled_camera(camera, 0.5) for camera in filmed.lost().values()]
    assert np.ptp([camera.K for camera in lost], axis=0).max() == 0.0  # all have one lens
    files = {"all": lost, "two": lost[:2], "one": [replace(lost[0], name="phone")]}
    for name, cameras in files.items():
        write_cameras(folder / f"{name}.json", cameras)
    return {name: folder / f"{name}.json" for name in files}


@pytest.mark.parametrize("given", ["all", "one"])
def test_lenses_of_a_file_are_used_as_they_are(
    filmed: Filmed, keypoint_files: dict[str, Path], lens_files: dict[str, Path], given: str
) -> None:
    offset = dict.fromkeys(keypoint_files, 0.0)
    rig = km.calibrate_from_person(keypoints=keypoint_files, offset=offset, lenses=lens_files[given])
    for name, camera in rig.cameras.items():
        true = filmed.cameras[name]
        assert abs(np.log(true.K[0, 0] / max(true.image_size) / PHONES)) > 3.0 * PHONES_STD  # no guess comes near
        np.testing.assert_allclose(camera.K, true.K, rtol=1e-6)
        assert (camera.name, camera.focal_std, rig.focal_stds[name]) == (name, 0.0, 0.0)
    assert turns_off(rig, filmed.cameras).max() < 1.0
    assert not any("focal length" in note for note in rig.notes)
    assert sum(f"the lenses are those of {lens_files[given]}" in note for note in rig.notes) == 1
    served = f"the camera 'phone' of {lens_files[given]} is used for 'cam01', 'cam02', 'cam03'"
    assert any(served in note for note in rig.notes) is (given == "one")


@pytest.mark.parametrize(
    ("given", "changes", "message"),
    [
        ("all", {"cameras": None}, "^--lenses: is for cameras that are found from a person .add --cameras auto"),
        ("all", {"focal": "26mm"}, "^--lenses: gives the focal length, as --focal does .leave one of them out"),
        ("all", {"phone": "iPhone X"}, "^--lenses: gives the focal length, as --phone does .leave one of them out"),
        ("two", {}, "two.json: there is no camera 'cam03' .cameras: cam01, cam02"),
        ("no", {}, "no.json: there is no such file"),
    ],
)
def test_unusable_lenses_are_refused(
    keypoint_files: dict[str, Path], lens_files: dict[str, Path], given: str, changes: dict[str, Any], message: str
) -> None:
    options: dict[str, Any] = {"cameras": "auto", "keypoints": keypoint_files, **changes}
    lenses = lens_files["all"].with_name(f"{given}.json")
    with pytest.raises(InputError, match=message):
        km.track("human34", None, lenses=lenses, **options)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"keypoints": None}, "are needed"),
        ({"height": -1.0}, "height"),
        ({"phone": "nothing"}, "not known"),
        ({"picture": "rig.txt"}, "not a .png file"),
        ({"picture": "nowhere/rig.png"}, "folder"),
    ],
)
def test_bad_arguments_are_named(keypoint_files: dict[str, Path], changes: dict[str, object], message: str) -> None:
    given: dict[str, object] = {"keypoints": keypoint_files, **changes}
    with pytest.raises(InputError, match=message):
        km.calibrate_from_person(**given)  # type: ignore[arg-type]


def test_what_leaves_cameras_in_doubt_is_named() -> None:
    """By the motion and the cameras' places: each cause is named where it applies, and none otherwise."""
    rng = np.random.default_rng(0)
    person = rng.normal(0.0, 0.4, (1, 12, 3)) + rng.normal(0.0, 0.05, (200, 12, 3))
    path = rng.normal(0.0, 1.0, (200, 1, 3)) * [1.0, 1.0, 0.0]
    centres = np.array([[4.0, 0.0, 1.0], [0.0, 4.0, 1.0], [4.0, 0.3, 1.0]])
    assert causes(person + path, 20.0, centres, 1) == []
    assert causes(person + path, 3.0, centres, 1) == ["the clips share 3.0 s"]
    assert causes(person, 20.0, centres, 1) == ["the person stays in one place"]
    assert causes(person + path * [1.0, 0.01, 0.0], 20.0, centres, 1) == ["the person moves along one line"]
    flat = (person + path) * [1.0, 1.0, 0.01]
    assert causes(flat, 20.0, centres, 1) == ["all points are nearly in one plane"]
    assert causes(person + path, 20.0, centres[[0, 2]], 1) == ["it looks from the same side as the others"]
    assert in_words(["a", "b", "c"]) == " (a, b and c)"
    assert in_words([]) == ""
