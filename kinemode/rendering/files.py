"""The files of a rendered clip: which there are, and writing them."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from estimator import synthesis
from estimator.cameras.camera import Camera
from estimator.formats.keypoints import write_keypoints
from estimator.media.film import write_film
from estimator.media.picture import write_picture
from estimator.synthesis import DetectorSettings, SceneSettings
from humanoid.kinematics.body import Body, PosedBody
from humanoid.support.errors import InputError
from kinemode.terminal.progress import Progress


@dataclass(frozen=True)
class RenderedClip:
    """Files of a rendered clip, by camera name where there is one a camera.

    videos: mp4, empty where only the rest was asked for. keypoints: as a detector would give them. first_frame: exact
    places of all landmarks in the first frame, and in no other. plates: PNG of the empty scene; empty where the
    background moves. cameras, truth, subject: camera file, true motion, and URDF of the body in the pictures.
    masks: by camera, the folder of one PNG a frame, white where the body is visible; empty unless asked for.
    """

    videos: dict[str, Path]
    keypoints: dict[str, Path]
    first_frame: dict[str, Path]
    plates: dict[str, Path]
    cameras: Path
    truth: Path
    subject: Path
    masks: dict[str, Path] = field(default_factory=dict)


def clip_files(folder: Path, names: list[str], scene: SceneSettings, videos: bool, masks: bool) -> RenderedClip:
    """The paths of a clip in a folder; makes its folders, and removes plates and masks of an earlier clip."""
    for stale in (*folder.glob("plate_*.png"), *folder.glob("masks/*/*.png")):
        stale.unlink()
    still = scene.background != "moving"
    return RenderedClip(
        {name: folder / f"{name}.mp4" for name in names} if videos else {},
        {name: made_folder(folder / "keypoints") / f"{name}.json" for name in names},
        {name: made_folder(folder / "first_frame") / f"{name}.json" for name in names},
        {name: folder / f"plate_{name}.png" for name in names} if videos and still else {},
        folder / "cameras.json",
        folder / "truth.npz",
        folder / "subject.urdf",
        {name: made_folder(folder / "masks" / name) for name in names} if masks else {},
    )


def made_folder(folder: Path) -> Path:
    """The folder, made if it is not there; raises InputError where that cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(folder, f"cannot be made: {error.strerror}", remedy="name a folder of your own") from None
    return folder


def write_clip_keypoints(
    clip: RenderedClip,
    body: Body,
    q: np.ndarray,
    cameras: tuple[Camera, ...],
    detector: DetectorSettings,
    rng: np.random.Generator,
    fps: float,
) -> None:
    """Write the detector's keypoints along q (T, nq), errors drawn from `rng`, and the exact first frame."""
    noisy = synthesis.keypoints(
        body, q, cameras, rng, noise_px=detector.noise_px, outlier_fraction=detector.outlier_fraction,
        missing_fraction=detector.missing_fraction, fps=fps,
    )  # fmt: skip
    exact = synthesis.first_frame(body, q, cameras, fps)
    for camera, track, first in zip(cameras, noisy, exact, strict=True):
        write_keypoints(clip.keypoints[camera.name], track)
        write_keypoints(clip.first_frame[camera.name], first)


def write_pictures(
    clip: RenderedClip,
    renderer: synthesis.Renderer,
    body: Body,
    q: np.ndarray,
    fps: float,
    seed: int,
    progress: Progress,
) -> None:
    """Write videos, plates and masks of q (T, nq), as far as the clip has them; `seed` is that of the sensor."""
    cameras = renderer.cameras
    opened = [while_open(body, q, t, renderer.settings) for t in range(len(q))]
    for c, camera in enumerate(cameras):
        rng = np.random.default_rng((seed, 2, c))
        if camera.name in clip.plates:
            write_picture(clip.plates[camera.name], renderer.plate(c))

        def picture(t: int, c: int = c, rng: np.random.Generator = rng) -> np.ndarray:
            progress(c * len(q) + t + 1, len(cameras) * len(q))
            return renderer.frame(opened[t], c, rng, t / fps)

        if camera.name in clip.videos:
            write_film(clip.videos[camera.name], map(picture, range(len(q))), fps, fine=True)
        if camera.name in clip.masks:
            for t, one in enumerate(q):
                mask = renderer.maps(body.at(one), c).mask
                write_picture(clip.masks[camera.name] / f"{t:05d}.png", np.where(mask, 255, 0).astype(np.uint8))


def while_open(body: Body, q: np.ndarray, t: int, scene: SceneSettings) -> list[PosedBody]:
    """The body while the shutter is open for frame t: half of that time before the frame's instant, half after."""
    if scene.shutter == 0.0 or scene.sub_frames == 1:
        return [body.at(q[t])]
    before = body.difference(q[t], q[max(t - 1, 0)])
    after = body.difference(q[t], q[min(t + 1, len(q) - 1)])
    shares = scene.shutter * (np.arange(scene.sub_frames) + 0.5) / scene.sub_frames - 0.5 * scene.shutter
    return [body.at(body.integrate(q[t], s * after if s > 0.0 else -s * before)) for s in shares]
