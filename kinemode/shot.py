"""A motion before cameras, written as the files of a clip: the one renderer of clips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.cameras import write_cameras
from estimator.data.formats.keypoints import write_keypoints
from estimator.data.media.film import write_film
from estimator.data.media.picture import write_picture
from estimator.synthesis.detector import first_frame, keypoints, without
from estimator.synthesis.plate import ORIGIN, MotionArea
from estimator.synthesis.render import Maps, Renderer
from estimator.synthesis.scene import write_truth
from estimator.synthesis.settings import DetectorSettings, SceneSettings
from humanoid.kinematics.body import Body, PosedBody
from kinemode.progress import Progress, Reporter, unreported
from kinemode.target import made_folder


@dataclass(frozen=True)
class RenderedClip:
    """Files of a rendered clip, by camera name where there is one a camera.

    videos: mp4, empty where only the rest was requested. keypoints: as a detector would give them. first_frame: exact
    places of all landmarks in the first frame, and in no other. plates: PNG of the empty scene; empty where the
    background moves. cameras, truth, subject: camera file, true motion, and URDF of the body in the pictures. masks: by
    camera, the folder of one PNG a frame, white where the body is visible; empty unless requested. depths: by camera,
    the folder of one 16-bit PNG a frame, the exact depth in mm, 0 where there is nothing; empty unless requested for.
    """

    videos: dict[str, Path]
    keypoints: dict[str, Path]
    first_frame: dict[str, Path]
    plates: dict[str, Path]
    cameras: Path
    truth: Path
    subject: Path
    masks: dict[str, Path] = field(default_factory=dict)
    depths: dict[str, Path] = field(default_factory=dict)


class WantedFiles(NamedTuple):
    """The files of a clip requested besides those that every clip has."""

    videos: bool = True
    masks: bool = False
    depths: bool = False


def clip_files(folder: Path, names: list[str], scene: SceneSettings, wanted: WantedFiles) -> RenderedClip:
    """The paths of a clip in a folder; makes its folders, and removes plates, masks and depths of an earlier clip."""
    for stale in (*folder.glob("plate_*.png"), *folder.glob("masks/*/*.png"), *folder.glob("depths/*/*.png")):
        stale.unlink()
    still = scene.background != "moving"
    return RenderedClip(
        {name: folder / f"{name}.mp4" for name in names} if wanted.videos else {},
        {name: made_folder(folder / "keypoints") / f"{name}.json" for name in names},
        {name: made_folder(folder / "first_frame") / f"{name}.json" for name in names},
        {name: folder / f"plate_{name}.png" for name in names} if wanted.videos and still else {},
        folder / "cameras.json",
        folder / "truth.npz",
        folder / "subject.urdf",
        {name: made_folder(folder / "masks" / name) for name in names} if wanted.masks else {},
        {name: made_folder(folder / "depths" / name) for name in names} if wanted.depths else {},
    )


_FARTHEST = 65536.0  # mm, beyond what 16 bits hold


class FilmedMotion(NamedTuple):
    """The filmed motion: q (T, nq) of a body at times (T,) [s], `fps` frames per second, by cameras in a place."""

    body: Body
    q: np.ndarray
    times: np.ndarray
    fps: float
    cameras: tuple[Camera, ...]
    scene: SceneSettings
    place: MotionArea = ORIGIN


class RandomSources(NamedTuple):
    """Where the random numbers are from: of the keypoints' errors, of room and clothes, of each camera's sensor."""

    keypoints: np.random.Generator
    scene: np.random.Generator
    sensors: Sequence[np.random.Generator]


def write_shot(
    folder: str | Path,
    shot: FilmedMotion,
    draws: RandomSources,
    detector: DetectorSettings,
    *,
    wanted: WantedFiles = WantedFiles(),  # noqa: B008, it cannot change
    progress: Reporter = unreported,
) -> RenderedClip:
    """Write cameras, truth, body, keypoints, and the requested pictures; see `kinemode.render`.

    Raises InputError where the folder cannot be written.
    """
    body, q = shot.body, shot.q
    clip = clip_files(made_folder(Path(folder)), [c.name for c in shot.cameras], shot.scene, wanted)
    write_cameras(clip.cameras, shot.cameras)
    write_truth(clip.truth, body, q, shot.times)
    body.subject.write(clip.subject)
    _write_keypoints(clip, shot, detector, draws.keypoints)
    if any(wanted):
        renderer = Renderer(body, shot.cameras, draws.scene, shot.scene, shot.place)
        with progress("rendering") as report:
            _write_pictures(clip, renderer, shot, draws.sensors, report)
    return clip


def _write_keypoints(
    clip: RenderedClip, shot: FilmedMotion, detector: DetectorSettings, rng: np.random.Generator
) -> None:
    """The detector's keypoints with errors drawn from `rng`, and the exact first frame."""
    noisy = keypoints(shot.body, shot.q, shot.cameras, rng, detector, fps=shot.fps)
    hidden = np.array([shot.scene.hides(time) for time in shot.times])
    exact = first_frame(shot.body, shot.q, shot.cameras, shot.fps)
    for camera, track, first in zip(shot.cameras, noisy, exact, strict=True):
        write_keypoints(clip.keypoints[camera.name], without(track, hidden))
        write_keypoints(clip.first_frame[camera.name], first)


def _write_pictures(
    clip: RenderedClip,
    renderer: Renderer,
    shot: FilmedMotion,
    sensors: Sequence[np.random.Generator],
    progress: Progress,
) -> None:
    """Videos, plates, masks and depths, as far as the clip has them; sensors: the noise of each camera's."""
    body, q, cameras = shot.body, shot.q, shot.cameras
    opened = [while_open(body, q, t, renderer.settings) for t in range(len(q))]
    for c, camera in enumerate(cameras):
        if camera.name in clip.plates:
            write_picture(clip.plates[camera.name], renderer.plate(c))

        def picture(t: int, c: int = c) -> np.ndarray:
            progress(c * len(q) + t + 1, len(cameras) * len(q))
            return renderer.frame(opened[t], c, sensors[c], t / shot.fps)

        if camera.name in clip.videos:
            write_film(clip.videos[camera.name], map(picture, range(len(q))), shot.fps, fine=True)
        if clip.masks or clip.depths:
            for t in range(len(q)):
                _write_maps(clip, camera.name, f"{t:05d}.png", renderer.maps(body.at(q[t]), c, t / shot.fps))


def _write_maps(clip: RenderedClip, camera: str, file: str, maps: Maps) -> None:
    """The mask and the depth of one frame, as far as the clip has them."""
    if camera in clip.masks:
        write_picture(clip.masks[camera] / file, np.where(maps.mask, 255, 0).astype(np.uint8))
    if camera in clip.depths:
        millimetres = np.where(np.isfinite(maps.depth), np.round(1e3 * maps.depth), 0.0)
        write_picture(clip.depths[camera] / file, np.where(millimetres < _FARTHEST, millimetres, 0.0).astype(np.uint16))


def while_open(body: Body, q: np.ndarray, t: int, scene: SceneSettings) -> list[PosedBody]:
    """The body while the shutter is open for frame t: half of that time before the frame's instant, half after."""
    if scene.shutter == 0.0 or scene.sub_frames == 1:
        return [body.at(q[t])]
    before = body.difference(q[t], q[max(t - 1, 0)])
    after = body.difference(q[t], q[min(t + 1, len(q) - 1)])
    shares = scene.shutter * (np.arange(scene.sub_frames) + 0.5) / scene.sub_frames - 0.5 * scene.shutter
    return [body.at(body.integrate(q[t], s * after if s > 0.0 else -s * before)) for s in shares]
