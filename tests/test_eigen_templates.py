"""Multi-view eigen-templates: patches, eigenspaces, foreground rays, training for a rig, proposals, and their file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import kinemode as km
from estimator.data.cameras.camera import Camera
from estimator.inference.beliefs.space import placements_of
from estimator.synthesis.limb_templates import middle_of, train_templates
from estimator.synthesis.pictures import variants
from estimator.synthesis.poses import PoseSampler
from estimator.synthesis.rig_pictures import RigExample, RigPainter
from estimator.synthesis.settings import ViewSettings
from estimator.synthesis.views import framing_cameras
from estimator.trackers.loose_limbed.limbs.likelihood import common_box
from estimator.trackers.loose_limbed.part_detectors.templates import (
    LimbTemplates,
    TemplateSettings,
    best_apart,
    load_templates,
    save_templates,
    template_proposals,
)
from estimator.vision.eigen_templates import eigen_space
from estimator.vision.patches import CHANNELS, PatchView, patch_view, patches_at, ray_places, seen_by_all
from humanoid.kinematics.body import Body
from humanoid.limbs.graph import limb_graph
from humanoid.limbs.limb import LimbGraph
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError

SIDE = 8
SIZE = (320, 240)
BLACK = np.zeros(SIZE[::-1], np.uint8)
BODIES = 2
"""People to paint; making one takes as long as painting many poses."""


def rig(count: int = 3, about: float = 1.2, size: tuple[int, int] = SIZE) -> tuple[Camera, ...]:
    """Cameras around a block of `about` m on each side of the middle."""
    corners = about * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    return framing_cameras(corners[None], ViewSettings(count, 20.0, 10.0, 0.8, size))


@pytest.fixture(scope="module", autouse=True)
def few_bodies() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("estimator.synthesis.limb_templates._VARIANTS", BODIES)
        yield


@pytest.fixture(scope="module")
def graph() -> LimbGraph:
    return limb_graph(load_subject("human34"))


@pytest.fixture(scope="module")
def templates() -> LimbTemplates:
    return train_templates(load_subject("human34"), rig(), poses=40, limbs=("head", "left_shank"))


@pytest.fixture(scope="module")
def example(graph: LimbGraph) -> RigExample:
    """The first training pose of the templates, and its pictures."""
    subject = load_subject("human34")
    bodies = variants(subject, BODIES, np.random.default_rng((0, 1)))
    box = common_box(rig(), 12.0, 0.0)
    painter = RigPainter(PoseSampler(Body(subject), legs=True), graph, rig(), bodies, box)
    return painter.example(np.random.default_rng((0, 0, 0)))


def ball(camera: Camera, centre: np.ndarray, radius: float) -> PatchView:
    """A view of a ball whose grey falls from left to right."""
    width, height = camera.image_size
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    ways = camera.directions(np.stack([x, y], axis=-1).reshape(-1, 2).astype(float))
    to = camera.R_camera_world @ (centre - camera.centre_world)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    inside = (np.linalg.norm(to - (ways @ to)[:, None] * ways, axis=1) < radius).reshape(height, width)
    across = np.clip(120.0 - 100.0 * (ways[:, 0] * to[2] / ways[:, 2] - to[0]) / radius, 0, 255).reshape(height, width)
    return patch_view(camera, across.astype(np.uint8), inside)


def test_a_space_has_the_requested_share_of_variance() -> None:
    rng = np.random.default_rng(0)
    pictures = (
        rng.standard_normal((400, 30)) * np.linspace(3.0, 0.2, 30) @ np.linalg.qr(rng.standard_normal((30, 30)))[0]
    )
    total = pictures.var(axis=0, ddof=1).sum()
    for share in (0.5, 0.8, 0.95):
        space = eigen_space(pictures, share)
        kept = np.cumsum(space.variance) / total
        assert kept[-1] >= share > kept[-2]
        left_out = space.residual(pictures).sum() / (len(pictures) - 1)
        assert left_out / total == pytest.approx(1.0 - kept[-1], abs=1e-9)
        np.testing.assert_allclose(space.basis @ space.basis.T, np.eye(len(kept)), atol=1e-9)
        np.testing.assert_allclose(space.coefficients(pictures).var(axis=0, ddof=1), space.variance, rtol=1e-6)


def test_its_density_is_that_of_another_library() -> None:
    from scipy.stats import multivariate_normal

    rng = np.random.default_rng(1)
    pictures = rng.standard_normal((200, 12)) * np.linspace(2.0, 0.3, 12)
    space = eigen_space(pictures)
    across = np.eye(12) - space.basis.T @ space.basis
    covariance = space.basis.T @ np.diag(space.variance) @ space.basis + space.rest * across
    wanted = multivariate_normal(space.mean, covariance).logpdf(pictures)
    np.testing.assert_allclose(space.log_density(pictures), wanted, rtol=1e-8)


def test_a_patch_has_as_many_metres_at_every_depth() -> None:
    camera = rig(1)[0]
    looking = camera.R_camera_world[2]
    made = []
    for depth in (2.0, 3.0, 4.5):
        place = camera.centre_world + depth * looking
        made.append(patches_at([ball(camera, place, 0.2)], place[None], 0.8, 12, 1.0).reshape(CHANNELS, 12, 12))
    for patch in made:
        assert patch[0].sum() == pytest.approx(np.pi * 3.0**2, rel=0.06)  # a ball of a quarter of the patch's side
        np.testing.assert_allclose(patch[0], made[0][0], atol=0.25)
    np.testing.assert_allclose(made[2][1], made[0][1], atol=0.5)
    wider = patches_at([ball(camera, place, 0.2)], place[None], 1.6, 12, 1.0).reshape(CHANNELS, 12, 12)
    assert wider[0].sum() == pytest.approx(made[0][0].sum() / 4.0, rel=0.1)


def test_light_and_contrast_change_no_patch() -> None:
    camera = rig(1)[0]
    place = camera.centre_world + 3.0 * camera.R_camera_world[2]
    view = ball(camera, place, 0.3)
    share = view.foreground > 0.5
    grey = np.where(share, view.levels[0][..., 1], 0.0)
    darker = patch_view(camera, (0.5 * grey + 20.0).astype(np.float32), share)
    a, b = (patches_at([v], place[None], 0.8, SIDE, 1.0) for v in (view, darker))
    np.testing.assert_allclose(a, b, atol=0.04)  # an even cloth has no contrast to be normalised
    assert np.abs(a.reshape(CHANNELS, -1)[1]).max() > 0.5


def test_places_are_foreground_in_every_view() -> None:
    cameras, centre = rig(size=(640, 480)), np.array([0.2, -0.1, 0.3])
    views = [ball(camera, centre, 0.25) for camera in cameras]
    box = common_box(cameras, 12.0, 0.0)
    places = ray_places(views, box, 0.05)
    assert seen_by_all(views, places).all()
    away = np.linalg.norm(places - centre, axis=1)
    assert away.max() < 0.5
    as_asked = 4.0 / 3.0 * np.pi * 0.25**3 / 0.05**3
    assert as_asked < (away < 0.25).sum() < 2.0 * as_asked  # rays are whole pixels apart, nearer rather than farther
    outside = centre + 0.4 * cameras[0].R_camera_world[2]  # on the first view's ray, not in the others' foreground
    assert seen_by_all(views[:1], outside[None]).all()
    assert not seen_by_all(views, outside[None]).any()
    black = np.zeros((480, 640), np.uint8)
    nothing = [*views[:2], patch_view(cameras[2], black, black > 0)]
    assert len(ray_places(nothing, box, 0.05)) == 0


def test_a_training_patch_is_found_again_with_its_orientation(
    templates: LimbTemplates, graph: LimbGraph, example: RigExample
) -> None:
    """With all directions the space of all examples leaves no residual, and the nearest example is the patch itself."""
    rng = np.random.default_rng(3)
    patches = rng.standard_normal((30, 20)) * np.linspace(2, 1, 20)
    space = eigen_space(patches[:12], 0.999999)
    np.testing.assert_allclose(space.residual(patches[:12]), 0.0, atol=1e-4)
    assert space.residual(patches[12:]).min() > 1.0
    head = graph.index("head")
    middle = middle_of(graph.limbs[head], example.t[head], example.R[head])
    of_head = next(t for t in templates.templates if "head" in t.limbs)
    patch = patches_at(example.views, middle[None], of_head.metres, templates.side, templates.contrast)
    nearest = int(of_head.nearest(patch, 1)[0, 0])
    estimated = Rotation.from_quat(of_head.quaternion[nearest])
    assert (estimated.inv() * Rotation.from_matrix(example.R[head])).magnitude() < 1e-6
    assert np.linalg.norm(of_head.offset[nearest] + middle - example.t[head]) < 0.1  # its place was off the middle


def test_the_head_is_detected_in_place_and_both_sides_alike(
    templates: LimbTemplates, graph: LimbGraph, example: RigExample
) -> None:
    part_proposals = template_proposals(templates, graph, example.views)
    assert [len(proposals.points) for proposals in part_proposals if len(proposals.points)] == [50, 50, 50]
    head = graph.index("head")
    t, R = placements_of(part_proposals[head].points)
    best = np.linalg.norm(t - example.t[head], axis=1).min()
    assert best < 0.06
    assert (part_proposals[head].weights > 0.0).all()
    left = graph.index("left_shank")
    np.testing.assert_array_equal(part_proposals[left].points, part_proposals[graph.mirror[left]].points)
    only = template_proposals(templates, graph, example.views, TemplateSettings(places=3, nearest=2), ["head"])
    assert [len(proposals.points) for proposals in only if len(proposals.points)] == [6]
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape), atol=1e-6)


def test_an_empty_picture_gives_no_detections(templates: LimbTemplates, graph: LimbGraph) -> None:
    black = [patch_view(c, np.dstack([BLACK] * 3), BLACK > 0) for c in rig()]
    assert all(len(proposals.points) == 0 for proposals in template_proposals(templates, graph, black))


def test_the_best_places_are_apart() -> None:
    rng = np.random.default_rng(0)
    places, score = rng.uniform(0, 1, (500, 3)), rng.standard_normal(500)
    chosen = best_apart(places, score, 6, 0.3)
    apart = np.linalg.norm(places[chosen][:, None] - places[chosen], axis=2) + np.eye(len(chosen))
    assert apart.min() >= 0.3
    assert chosen[0] == score.argmax()
    assert (np.diff(score[chosen]) <= 0.0).all()


def test_a_file_gives_the_same_shouts(
    templates: LimbTemplates, graph: LimbGraph, example: RigExample, tmp_path: Path
) -> None:
    save_templates(templates, tmp_path / "rig.npz")
    again = load_templates(tmp_path / "rig.npz")
    for a, b in zip(
        template_proposals(templates, graph, example.views),
        template_proposals(again, graph, example.views),
        strict=True,
    ):
        assert len(a.points) == len(b.points)
        if len(a.points):
            np.testing.assert_allclose(a.points[:25], b.points[:25], atol=1e-4)
    with np.load(tmp_path / "rig.npz") as file:
        arrays = dict(file)
    arrays["quaternion_0"] = 2.0 * arrays["quaternion_0"]
    np.savez(tmp_path / "bad.npz", **arrays)
    with pytest.raises(InputError, match=r"damaged: template 0 .* train-templates"):
        load_templates(tmp_path / "bad.npz")
    np.savez(tmp_path / "other.npz", q=np.zeros(3))
    with pytest.raises(InputError, match=r"is not a file of limb templates"):
        load_templates(tmp_path / "other.npz")


def test_another_rig_or_body_is_refused(templates: LimbTemplates, graph: LimbGraph) -> None:
    cameras = rig()
    templates.check_rig([replace(c, image_size=(160, 120), K=np.diag([0.5, 0.5, 1.0]) @ c.K) for c in cameras])
    moved = replace(cameras[1], t_camera_world=cameras[1].t_camera_world + np.array([0.0, 0.0, 0.3]))
    for other in (cameras[:2], (cameras[1], cameras[0], cameras[2]), (cameras[0], moved, cameras[2])):
        with pytest.raises(InputError, match=r"rig.* train-templates CAMERAS"):
            templates.check_rig(other)
    views = [patch_view(c, BLACK, BLACK > 0) for c in reversed(cameras)]
    with pytest.raises(InputError, match="another rig"):
        template_proposals(templates, graph, views)
    with pytest.raises(InputError, match=r"another graph: it has no"):
        templates.check_graph(limb_graph(load_subject("arm8")))


def test_the_command_writes_templates_of_any_body_and_reports_errors(tmp_path: Path) -> None:
    cameras = {camera.name: camera for camera in rig(2, 0.6)}
    km.write_cameras(tmp_path / "rig.json", list(cameras.values()))
    out = km.train_templates(tmp_path / "rig.json", tmp_path / "arm.npz", subject="arm8", poses=20)
    made = load_templates(out)
    made.check_rig(list(cameras.values()))
    made.check_graph(limb_graph(load_subject("arm8")))
    again = train_templates(load_subject("arm8"), list(cameras.values()), poses=20)
    np.testing.assert_allclose(again.templates[0].coefficients, made.templates[0].coefficients, atol=1e-4)
    with pytest.raises(InputError, match="exists already"):
        km.train_templates(cameras, out, subject="arm8")
    for how, message in (({"poses": 3}, "too few"), ({"limbs": "tail"}, "no such limb"), ({"poses": 0}, "1 or more")):
        with pytest.raises(InputError, match=message):
            km.train_templates(cameras, tmp_path / "x.npz", subject="arm8", **how)  # type: ignore[arg-type]
    assert not (tmp_path / "x.npz").exists()
