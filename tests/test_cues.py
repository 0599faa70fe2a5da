"""Image cues: known edges, flows and silhouettes are found; reading in any order gives the same."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from estimator.data.image_cues import ImageCues
from estimator.vision.camera_pictures import CameraPictures
from estimator.vision.cues.edges import EdgeSettings, edge_map
from estimator.vision.cues.flow import follow_points
from estimator.vision.cues.flow_field import FlowField, FlowSettings, flow_field
from estimator.vision.cues.foreground import (
    Background,
    SilhouetteSettings,
    background_beside,
    foreground_mask,
    learn_background,
    person_mask,
    silhouette_of,
)
from estimator.vision.cues.reader import CueReader, ReadAhead
from estimator.vision.cues.settings import cue_settings
from estimator.vision.cues.silhouette import BesidePerson, Outline
from estimator.vision.resolution import scaled_camera
from humanoid.support.errors import InputError
from tests.builders import BROWN, camera_at

HEIGHT, WIDTH = 120, 160
Y, X = np.mgrid[:HEIGHT, :WIDTH].astype(float)
SETTINGS = SilhouetteSettings(rounds=1)


def texture(seed: int, shape: tuple[int, int] = (HEIGHT, WIDTH), *, fine: float = 2.0, contrast: float = 30.0):
    """A smooth random picture (H, W, 3) float32 about grey value 120."""
    noise = np.random.default_rng(seed).standard_normal((*shape, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), fine)
    return 120.0 + contrast * smooth / smooth.std()


def picture(values: np.ndarray, rng: np.random.Generator | None = None, noise: float = 2.0) -> np.ndarray:
    values = values if rng is None else values + noise * rng.standard_normal(values.shape)
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def step(low: float, high: float, angle: float) -> np.ndarray:
    """Two even areas that meet in a line through the middle; the brighter lies towards `angle` [deg]."""
    along = (X - 79.5) * np.cos(np.radians(angle)) + (Y - 59.5) * np.sin(np.radians(angle))
    grey = low + (high - low) * np.clip(along + 0.5, 0.0, 1.0)
    return np.repeat(grey[..., None], 3, axis=-1)


@pytest.mark.parametrize("angle", [0.0, 90.0, 205.0])
def test_a_step_is_an_edge_whatever_its_contrast(angle: float) -> None:
    strong = edge_map(picture(step(60, 180, angle)), EdgeSettings())
    weak = edge_map(picture(step(90, 150, angle)), EdgeSettings())
    assert strong.strength[59:61, 79:81].max() > 0.9
    np.testing.assert_allclose(weak.strength, strong.strength, atol=0.06)
    expected = (np.cos(np.radians(angle)), np.sin(np.radians(angle)))
    np.testing.assert_allclose(strong.direction[60, 80], expected, atol=0.03)
    along = (X - 79.5) * expected[0] + (Y - 59.5) * expected[1]
    assert strong.strength[np.abs(along) > 8.0].max() < 0.02
    lengths = np.linalg.norm(strong.direction, axis=-1)
    np.testing.assert_allclose(lengths[strong.strength > 0.0], 1.0, atol=1e-5)
    assert not lengths[strong.strength == 0.0].any()


def test_a_step_of_colour_alone_is_an_edge() -> None:
    values = step(60, 180, 0.0)
    values[..., :2] = 120.0
    assert edge_map(picture(values), EdgeSettings()).strength[60, 78:82].max() > 0.9


def test_noise_is_not_an_edge() -> None:
    rng = np.random.default_rng(0)
    flat = edge_map(picture(np.full((HEIGHT, WIDTH, 3), 120.0), rng, 6.0), EdgeSettings()).strength
    assert np.quantile(flat, 0.99) < 0.5
    assert flat.mean() < 0.3
    beside = edge_map(picture(step(60, 180, 0.0), rng, 6.0), EdgeSettings()).strength
    assert beside[:, 79:81].mean() > 0.8


def test_flow_of_a_shifted_picture() -> None:
    wide = texture(1, (HEIGHT + 40, WIDTH + 40))
    shift = np.array([3.3, -1.6])
    moved = cv2.warpAffine(
        wide, np.float32([[1, 0, shift[0]], [0, 1, shift[1]]]), wide.shape[1::-1], flags=cv2.INTER_CUBIC
    )
    field = flow_field(picture(wide[20:-20, 20:-20]), picture(moved[20:-20, 20:-20]), FlowSettings())
    inner = field.flow[12:-12, 12:-12]
    assert np.median(np.abs(inner - shift), axis=(0, 1)).max() < 0.1
    assert np.quantile(np.linalg.norm(inner - shift, axis=-1), 0.95) < 0.2
    assert field.outlier[12:-12, 12:-12].mean() < 0.05
    assert field.boundary[20:-20, 20:-20].min() > 0.7


def test_motion_boundaries_lie_around_what_moves() -> None:
    room, thing = texture(2), texture(3, contrast=40.0)
    before, now = room.copy(), room.copy()
    before[40:80, 50:90] = thing[40:80, 50:90]
    now[40:80, 56:96] = thing[40:80, 50:90]
    field = flow_field(picture(before), picture(now), FlowSettings())
    flow, outlier = (on_the_whole(field, values) for values in (field.flow, field.outlier))
    boundary = field.whole_boundary()
    np.testing.assert_allclose(np.median(flow[48:72, 58:82], axis=(0, 1)), (6.0, 0.0), atol=0.2)
    outline = np.concatenate([boundary[42:78, (56, 95)].ravel(), boundary[(40, 79), 58:94].ravel()])
    assert np.mean(outline < 0.25) > 0.9
    away = np.hypot(np.maximum(np.abs(X - 75.5) - 20.0, 0.0), np.maximum(np.abs(Y - 59.5) - 20.0, 0.0)) > 24.0
    assert boundary[away].min() > 0.9
    assert outlier[44:76, 91:95].mean() > 0.5  # the part of the room that is covered
    assert outlier[away].mean() < 0.02


def test_flow_is_computed_only_where_something_moves() -> None:
    rng = np.random.default_rng(6)
    height, width = 3 * HEIGHT, 3 * WIDTH
    room, thing = texture(4, (height, width)), texture(5, (height, width), contrast=40.0)
    before, now = room.copy(), room.copy()
    before[100:180, 250:310], now[100:180, 255:315] = thing[100:180, 250:310], thing[100:180, 250:310]
    noisy = [picture(image, rng, 1.5) for image in (before, now)]
    field = flow_field(*noisy, FlowSettings())
    (left, top), (tall, wide) = field.corner, field.outlier.shape
    assert field.size == (width, height)
    assert tall * wide < 0.2 * width * height
    assert left < 250
    assert left + wide > 315
    assert top < 100
    assert top + tall > 180
    points = np.array([[275.0, 120.0], [300.0, 170.0], [30.0, 40.0], [width - 0.6, height - 0.6]])
    target, sure = follow_points(field, points, points + 9.0)
    np.testing.assert_allclose(target[:2] - points[:2], [[5.0, 0.0]] * 2, atol=0.2)
    np.testing.assert_allclose(target[2:], np.minimum(points[2:], np.array(field.size) - 1.0))
    assert (sure[2:] == 1.0).all()
    panned = flow_field(noisy[0], np.roll(noisy[1], 4, axis=1), FlowSettings())
    assert panned.corner == (0, 0)
    assert panned.outlier.shape == (height, width)


def on_the_whole(field: FlowField, values: np.ndarray) -> np.ndarray:
    """A map of a field resampled to the image, zero outside it."""
    (width, height), (x, y) = field.size, field.corner
    whole = np.zeros((height, width, *values.shape[2:]), values.dtype)
    whole[y : y + values.shape[0], x : x + values.shape[1]] = values
    return whole


def disc(x: float, y: float, radius: float) -> np.ndarray:
    return np.hypot(X - x, Y - y) < radius


def scene(
    rng: np.random.Generator, room: np.ndarray, mask: np.ndarray, thing: np.ndarray, shift: int = 0
) -> np.ndarray:
    return picture(np.where(mask[..., None], np.roll(thing, shift, axis=1), room), rng)


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.count_nonzero(a & b) / np.count_nonzero(a | b))


@pytest.fixture(scope="module")
def crossing() -> tuple[list[np.ndarray], list[np.ndarray], np.ndarray]:
    """A red disc that crosses a textured room in front of a noisy camera: frames, masks, room."""
    rng = np.random.default_rng(4)
    room, thing = texture(5, contrast=25.0), texture(6) * (0.4, 0.5, 1.5)
    at = np.linspace(20, 140, 31).round().astype(int)
    masks = [disc(x, 60.0, 16.0) for x in at]
    return [scene(rng, room, m, thing, x) for m, x in zip(masks, at, strict=True)], masks, room


def test_what_moves_is_foreground(crossing) -> None:
    frames, masks, room = crossing
    background = learn_background(frames, SETTINGS)
    assert background is not None
    assert background.known.mean() > 0.97
    assert np.median(np.abs(background.mean - room)) < 2.0
    for i in (3, 10, 22):
        assert overlap(foreground_mask(frames[i], background, SETTINGS), masks[i]) > 0.9


def test_shadow_is_background() -> None:
    rng, room = np.random.default_rng(7), texture(8, contrast=25.0)
    plate = Background(room, np.full_like(room, 2.0), np.ones(room.shape[:2], bool))
    body, shade = disc(60.0, 60.0, 16.0), disc(110.0, 60.0, 18.0)
    lit = room * np.where(shade, 0.65, 1.0)[..., None]
    image = scene(rng, lit, body, texture(9) * (0.4, 0.5, 1.5))
    assert overlap(foreground_mask(image, plate, SETTINGS), body) > 0.9
    assert not foreground_mask(picture(lit, rng), plate, SETTINGS).any()


def test_a_person_swaying_in_place_has_no_holes() -> None:
    rng, room, thing = np.random.default_rng(10), texture(11, contrast=25.0), texture(12) * (0.4, 0.5, 1.5)
    sway = np.round(6.0 * np.sin(np.arange(24) * 0.7)).astype(int)
    masks = [disc(80.0 + s, 60.0, 24.0) for s in sway]
    frames = [scene(rng, room, m, thing, int(s)) for m, s in zip(masks, sway, strict=True)]
    background = learn_background(frames, SETTINGS)
    assert background is not None
    assert not background.known[disc(80.0, 60.0, 12.0)].any()
    for i in (0, 9, 17):
        mask = foreground_mask(frames[i], background, SETTINGS)
        assert mask[masks[i]].mean() > 0.97
        assert overlap(mask, masks[i]) > 0.85


def test_a_person_at_a_known_place_is_excluded_from_the_background() -> None:
    """Masks that are too wide and 2 px off, of someone swaying in place: what is beside them is the scene, which cuts
    the person out exactly; where the scene was never seen the mask is used."""
    rng, room, thing = np.random.default_rng(10), texture(11, contrast=25.0), texture(12) * (0.4, 0.5, 1.5)
    sway = np.round(14.0 * np.sin(np.arange(24) * 0.7)).astype(int)
    true = [disc(80.0 + s, 60.0, 20.0) for s in sway]
    about: list[np.ndarray | None] = [disc(82.0 + s, 60.0, 21.0) for s in sway]
    frames = [scene(rng, room, m, thing, int(s)) for m, s in zip(true, sway, strict=True)]
    frames.append(picture(room, rng))
    background = background_beside(frames, [*about, None])
    assert background is not None
    assert np.abs(background.mean - room)[background.known].max() < 12.0
    assert not background.known[disc(80.0, 60.0, 4.0)].any()
    other = disc(20.0, 30.0, 10.0)
    for i in (0, 9, 17):
        rough = about[i]
        assert rough is not None
        with_other = np.where(other[..., None], texture(6).astype(np.uint8), frames[i])
        mask = person_mask(with_other, rough, background, SETTINGS)
        assert overlap(mask, true[i]) > 0.94 > overlap(rough, true[i])
        assert overlap(person_mask(frames[i], rough, None, SETTINGS), rough) > 0.97


def test_a_moving_camera_has_no_background() -> None:
    wide, rng = texture(13, (HEIGHT, WIDTH + 120)), np.random.default_rng(14)
    assert learn_background([picture(wide[:, 4 * i : 4 * i + WIDTH], rng) for i in range(24)], SETTINGS) is None
    assert learn_background([picture(wide[:, :WIDTH], rng)], SETTINGS) is None
    assert background_beside([picture(wide[:, 4 * i : 4 * i + WIDTH], rng) for i in range(24)], [None] * 24) is None


def test_silhouette_of_a_disc() -> None:
    mask = disc(80.0, 58.0, 30.0)
    outline = silhouette_of(mask)
    offset = outline.boundary - (80.0, 58.0)
    radius = np.linalg.norm(offset, axis=-1)
    np.testing.assert_allclose(radius, 30.0, atol=0.6)
    assert abs(radius.mean() - 30.0) < 0.15
    assert (np.einsum("mi,mi->m", outline.normal, offset / radius[:, None]) > np.cos(np.radians(7.0))).all()
    np.testing.assert_allclose(outline.distance, np.hypot(X - 80.0, Y - 58.0) - 30.0, atol=0.8)
    to_all = np.linalg.norm(np.stack([X, Y], axis=-1)[::7, ::7, None] - outline.boundary, axis=-1)
    chosen = np.take_along_axis(to_all, outline.nearest[::7, ::7, None].astype(int), axis=-1)[..., 0]
    assert (chosen - to_all.min(axis=-1)).max() < 1.0
    angle = np.sort(np.arctan2(offset[:, 1], offset[:, 0]))
    assert 30.0 * np.diff(angle).max() < 2.1


def test_silhouettes_end_at_the_border_of_the_image() -> None:
    half = silhouette_of(Y >= 60)
    assert np.abs(half.boundary[:, 1] - 59.5).max() < 0.1
    np.testing.assert_allclose(half.normal, np.tile((0.0, -1.0), (len(half.normal), 1)), atol=1e-6)
    np.testing.assert_allclose(half.distance, 59.5 - Y, atol=1e-3)
    for empty in (np.zeros((HEIGHT, WIDTH), bool), np.ones((HEIGHT, WIDTH), bool)):
        none = silhouette_of(empty)
        assert len(none.boundary) == 0
        assert (none.nearest == -1).all()
        assert np.isinf(none.distance).all()


def test_a_scaled_camera_projects_to_scaled_pixels() -> None:
    camera = replace(camera_at(30.0, distortion=BROWN), image_size=(642, 483))
    points = np.random.default_rng(15).uniform(-0.8, 0.8, (50, 3))
    small = scaled_camera(camera, 1.0 / 3.0)
    assert small.image_size == (214, 161)
    np.testing.assert_allclose(small.project(points), (camera.project(points) + 0.5) / 3.0 - 0.5, atol=1e-9)


def write_images(folder: Path, images: list[np.ndarray]) -> Path:
    folder.mkdir()
    for i, image in enumerate(images):
        cv2.imwrite(str(folder / f"{i}.png"), image)
    return folder


def same(a: tuple[ImageCues, ...], b: tuple[ImageCues, ...]) -> None:
    for ours, other in zip(a, b, strict=True):
        assert list(ours) == list(other)
        np.testing.assert_array_equal(ours.picture, other.picture)
        for cue, read in ours.items():
            for name, value in vars(read).items():
                np.testing.assert_array_equal(value, getattr(other[cue], name))


def test_any_order_gives_the_same_cues(tmp_path: Path, crossing) -> None:
    frames, masks, room = crossing
    camera = replace(camera_at(0.0), image_size=(WIDTH, HEIGHT))
    clips = [write_images(tmp_path / "clip", frames[:12])] * 2
    people = write_images(tmp_path / "masks", [255 * m.astype(np.uint8) for m in masks[:12]])
    plate = tmp_path / "plate.png"
    cv2.imwrite(str(plate), picture(room))
    sources = {"masks": [people, None], "plates": [None, plate]}
    settings = cue_settings(working_size=120)
    reader = CueReader(clips, [camera] * 2, settings, **sources)
    in_order = [reader.at(i) for i in range(12)]
    assert "flow" not in in_order[0][0]
    for i, cues in enumerate(in_order):
        assert cues[0].camera.image_size == (120, 90)
        truth = cv2.resize(masks[i].astype(np.uint8) * 255, (120, 90), interpolation=cv2.INTER_AREA) > 127
        np.testing.assert_array_equal(cues[0]["silhouette"].mask, truth)
        assert overlap(cues[1]["silhouette"].mask, truth) > 0.85
    threads = cv2.getNumThreads()
    try:
        for number, other in ((1, reader), (4, CueReader(clips, [camera] * 2, settings, **sources))):
            cv2.setNumThreads(number)
            for i in (7, 3, 11, 0, 4, 4):
                same(other.at(i), in_order[i])
    finally:
        cv2.setNumThreads(threads)
    with pytest.raises(InputError, match="frame 12"):
        reader.at(12)
    ahead = ReadAhead(reader)
    for i in (0, 1, 2, 7, 8, 3, 10, 11):  # in the order of a track, then out of order
        same(ahead.at(i), in_order[i])
    with pytest.raises(InputError, match="frame 12"):  # prefetched before, now read
        ahead.at(12)
    same(ahead.at(5), in_order[5])
    ahead.close()
    assert cv2.getNumThreads() == threads


def test_bad_input_is_named(tmp_path: Path, crossing) -> None:
    clip = write_images(tmp_path / "clip", crossing[0][:3])
    small = write_images(tmp_path / "small", [crossing[0][0][:60, :80]])
    camera = replace(camera_at(0.0), image_size=(WIDTH, HEIGHT))
    for keywords in ({"masks": [small]}, {"plates": [small / "0.png"]}, {"plates": [tmp_path / "none.png"]}):
        with pytest.raises(InputError, match=r"small|none\.png"):
            CueReader([clip], [camera], cue_settings(), **keywords)
    with pytest.raises(InputError, match="160 x 120"):
        CueReader([clip], [replace(camera, image_size=(640, 480))], cue_settings())
    with pytest.raises(InputError, match="0 or more, at most 2"):
        FlowSettings(finest_scale=5)
    for bad in (EdgeSettings, FlowSettings, SilhouetteSettings):
        with pytest.raises(InputError, match="-1"):
            bad(**{next(n for n in vars(bad()) if n != "finest_scale"): -1.0})


def test_a_moving_camera_is_noted(tmp_path: Path) -> None:
    wide = texture(16, (HEIGHT, WIDTH + 60))
    clip = write_images(tmp_path / "clip", [picture(wide[:, 4 * i : 4 * i + WIDTH]) for i in range(12)])
    reader = CueReader([clip], [replace(camera_at(0.0), image_size=(WIDTH, HEIGHT))], cue_settings())
    assert reader.notes == ("at0: the camera moves, no background model",)
    assert "silhouette" not in reader.at(5)[0]
    pictures = CameraPictures(clip, replace(camera_at(0.0), image_size=(WIDTH, HEIGHT)), 2 * WIDTH)
    pictures.person_masks = SimpleNamespace(mask=lambda instant: np.eye(HEIGHT, WIDTH, dtype=bool))
    assert Outline().prepare(pictures, SilhouetteSettings()) == BesidePerson(None)
    assert pictures.notes == ("at0: the camera moves, no background model; the person is as wide as depth has them",)


def test_instants_need_not_be_the_clips_frames(tmp_path: Path, crossing) -> None:
    frames, _, _ = crossing
    camera = replace(camera_at(0.0), image_size=(WIDTH, HEIGHT))
    clip = write_images(tmp_path / "clip", frames[:8])
    settings = cue_settings(["edges", "flow"], working_size=120)
    whole = CueReader([clip], [camera], settings)
    part = CueReader([clip] * 2, [camera] * 2, settings, frames=[np.arange(3, 8), np.array([3, 3, 4, 4, 5])])
    for i in (2, 1, 4):
        same(part.at(i)[:1], whole.at(3 + i))
    assert "flow" not in part.at(0)[0]
    for i in range(5):  # a picture for two instants shows no motion, and then that of both
        np.testing.assert_array_equal(part.at(i)[1]["edges"].strength, whole.at(3 + i // 2)[0]["edges"].strength)
        assert "flow" not in part.at(i)[1]
    with pytest.raises(InputError, match="instant 5"):
        part.at(5)
