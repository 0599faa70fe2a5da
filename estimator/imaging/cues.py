"""The image cues of one instant: edges, flow and silhouette of every camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from estimator.cameras.camera import Camera
from estimator.imaging.background import FEWEST_FRAMES
from estimator.imaging.edges import EdgeMap, EdgeSettings, edge_map
from estimator.imaging.flow import FlowField, FlowSettings, flow_field
from estimator.imaging.foreground import (
    Background,
    Silhouette,
    SilhouetteSettings,
    foreground_mask,
    learn_background,
    silhouette_of,
)
from estimator.imaging.resolution import resized_camera
from estimator.media.clip import Clip
from estimator.media.picture import read_picture
from estimator.media.threads import one_thread
from humanoid.support.errors import InputError
from humanoid.support.settings import check, setting

_SAME_STEP = 0.1  # share of the usual step from one picture to the next that a step may differ by, to be followed


@dataclass(frozen=True)
class CueSettings:
    """Which cues are computed, and how.

    working_size: longest side of the pictures they are computed from [px]; larger frames are reduced to it.
    """

    working_size: int = setting(640, at_least=64)
    use_edges: bool = True
    use_flow: bool = True
    use_silhouette: bool = True
    edges: EdgeSettings = field(default_factory=EdgeSettings)
    flow: FlowSettings = field(default_factory=FlowSettings)
    silhouette: SilhouetteSettings = field(default_factory=SilhouetteSettings)

    def __post_init__(self) -> None:
        check(self)


@dataclass(frozen=True)
class ImageCues:
    """What one camera's image says at one instant; None for a cue that is not used or not available.

    camera: at the working resolution, that of all the maps.
    edges, flow, silhouette: the cues; there is no flow at the first frame, no silhouette without a background.
    """

    camera: Camera
    edges: EdgeMap | None
    flow: FlowField | None
    silhouette: Silhouette | None


def scaled_camera(camera: Camera, factor: float) -> Camera:
    """The camera of an image resized by `factor`.

    Image sides are rounded to whole pixels, and K follows the ratio of the rounded sides, as resizing does.
    """
    size = (max(1, round(camera.image_size[0] * factor)), max(1, round(camera.image_size[1] * factor)))
    return resized_camera(camera, size)


class CueReader:
    """Reads the cues of synchronised clips, one a camera.

    clips: open clips or their paths. cameras: in the same order.
    masks: for each camera a folder of images or a video, white on the person, or None; they replace the background.
    plates: for each camera a picture of the empty scene, or None.
    frames: for each camera the number of its clip's frame at each instant (T,), or None where that is the instant's.

    Attributes
    ----------
    notes: what a user should hear of.

    Raises
    ------
    InputError: a file cannot be read, or its size is not the camera's.
    """

    def __init__(
        self,
        clips: Sequence[Clip | Path],
        cameras: Sequence[Camera],
        settings: CueSettings,
        *,
        masks: Sequence[Path | None] | None = None,
        plates: Sequence[Path | None] | None = None,
        frames: Sequence[np.ndarray | None] | None = None,
    ) -> None:
        none = (None,) * len(cameras)
        self._views = tuple(
            _View(clip, camera, settings, mask, plate, numbers)
            for clip, camera, mask, plate, numbers in zip(
                clips, cameras, masks or none, plates or none, frames or none, strict=True
            )
        )
        self.notes = tuple(note for view in self._views for note in view.notes)

    def at(self, index: int) -> tuple[ImageCues, ...]:
        """Cues of every camera at instant `index`, the same whatever was read before; InputError past a clip's end."""
        return tuple(view.at(index) for view in self._views)

    def close(self) -> None:
        """Let go of the files."""
        for view in self._views:
            view.close()


class _View:
    """One camera's clip and what is known of its background."""

    def __init__(
        self,
        clip: Clip | Path,
        camera: Camera,
        settings: CueSettings,
        mask: Path | None,
        plate: Path | None,
        frames: np.ndarray | None,
    ) -> None:
        self._clip = clip if isinstance(clip, Clip) else Clip.open(clip)
        self._settings = settings
        self._frames = frames
        _check_size(self._clip.path, self._clip.image_size, camera)
        self.camera = scaled_camera(camera, min(1.0, settings.working_size / max(camera.image_size)))
        self._masks = Clip.open(mask) if mask else None
        if self._masks is not None:
            _check_size(self._masks.path, self._masks.image_size, camera)
        self._background: Background | None = None
        self._latest: dict[int, np.ndarray] = {}
        self.notes: tuple[str, ...] = ()
        if settings.use_silhouette and self._masks is None:
            self._background = self._learned() if plate is None else self._from_plate(plate, camera)

    def at(self, index: int) -> ImageCues:
        """Cues at one instant."""
        chosen, frame = self._settings, self._frame_of(index)
        before = self._frame_before(index) if chosen.use_flow else None
        previous = None if before is None else self._picture(before)
        picture = self._picture(frame)
        flow = None if previous is None else flow_field(previous, picture, chosen.flow)
        edges = edge_map(picture, chosen.edges) if chosen.use_edges else None
        return ImageCues(self.camera, edges, flow, self._silhouette(frame, picture) if chosen.use_silhouette else None)

    def close(self) -> None:
        """Let go of the files."""
        self._clip.close()
        if self._masks is not None:
            self._masks.close()

    def _frame_of(self, index: int) -> int:
        if self._frames is None:
            return index
        if index >= len(self._frames):
            raise InputError(self._clip.path, "has no frame there", place=f"instant {index}")
        return int(self._frames[index])

    def _frame_before(self, index: int) -> int | None:
        """The frame at the instant before, None where the motion between the two pictures is not that between the
        instants: a camera with fewer pictures than there are instants shows some of them twice."""
        if index == 0:
            return None
        before = self._frame_of(index - 1)
        if self._frames is None:
            return before
        usual = (self._frames[-1] - self._frames[0]) / (len(self._frames) - 1)
        return before if abs(self._frame_of(index) - before - usual) <= _SAME_STEP * usual else None

    def _picture(self, index: int) -> np.ndarray:
        """A frame at the working resolution; the last two are kept."""
        if index not in self._latest:
            picture = self._reduced(_frame(self._clip, index))
            self._latest = {**{i: p for i, p in self._latest.items() if abs(i - index) == 1}, index: picture}
        return self._latest[index]

    @one_thread()
    def _reduced(self, image: np.ndarray) -> np.ndarray:
        return np.asarray(cv2.resize(image, self.camera.image_size, interpolation=cv2.INTER_AREA))

    def _silhouette(self, index: int, picture: np.ndarray) -> Silhouette | None:
        if self._masks is not None:
            return silhouette_of(self._reduced(_frame(self._masks, index)).max(axis=-1) > 127)
        if self._background is None:
            return None
        mask = foreground_mask(picture, self._background, self._settings.silhouette)
        return silhouette_of(mask, self._background.known)

    def _learned(self) -> Background | None:
        count = self._clip.frame_count or self._clip.report.read
        wanted = np.unique(np.linspace(0, count - 1, self._settings.silhouette.frames).astype(int))
        pictures = [self._reduced(self._clip.frame(int(i))) for i in wanted]
        background = learn_background(pictures, self._settings.silhouette)
        if background is None:
            why = "the camera moves" if len(pictures) >= FEWEST_FRAMES else "the clip is too short"
            self.notes += (f"{self.camera.name}: {why}, no background model",)
        return background

    def _from_plate(self, path: Path, camera: Camera) -> Background:
        plate, whole = read_picture(path)
        if not whole:
            self.notes += (f"{self.camera.name}: {path.name} is damaged and not seen as it was",)
        _check_size(path, (plate.shape[1], plate.shape[0]), camera)
        mean = self._reduced(plate).astype(np.float32)
        return Background(mean, np.full_like(mean, 2.0), np.ones(mean.shape[:2], bool))


def _frame(clip: Clip, index: int) -> np.ndarray:
    try:
        return clip.frame(index)
    except IndexError:
        raise InputError(clip.path, "has no such frame", place=f"frame {index}") from None


def _check_size(source: Path, size: tuple[int, int], camera: Camera) -> None:
    if tuple(size) != tuple(camera.image_size):
        expected = "{} x {}".format(*camera.image_size)
        raise InputError(source, f"is {size[0]} x {size[1]} pixels, the camera {camera.name!r} has {expected}")
