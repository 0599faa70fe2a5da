"""Two rendered people in different clothes who cross each other's way in front of four cameras: how well does the
detector of `kinemode detect` see them, together and alone? Whether they could be tracked with `--person all` from such
films depends on it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

import kinemode as km
from benchmarks.accuracy.crowd_clips import Clip, room_cameras
from benchmarks.accuracy.everybody import REACHED, crossing
from benchmarks.support.common import Json, Work, save, tell, work_folder
from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import load_people
from estimator.data.media.clip import DEFAULT_FPS as FPS
from estimator.data.media.film import write_film
from estimator.synthesis.clothing import Garment, dressed
from estimator.synthesis.plate import place_of
from estimator.synthesis.render import Renderer
from estimator.synthesis.settings import SceneSettings
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import FORMATS
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.target import made_folder
from kinemode.terminal import report

SIZE = (1280, 720)
TOGETHER, ALONE = "both", {"first": 0, "second": 1}
NOISE = 2.5  # of the sensor, in grey values
NEAR = 0.25  # of a person's height in the picture: a detection whose limb joints are so near, at the median, is of them
LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
JERSEY = Garment((40.0, 120.0, 190.0), 0.16, 0.12, 0.22, 0.05)
OTHERS = {
    **dict.fromkeys(("torso", "upper_arm", ""), JERSEY),
    **dict.fromkeys(("pelvis", "thigh", "shank"), Garment((160.0, 150.0, 150.0), 0.2, 0.16)),
}
Films = dict[str, Path]


@dataclass(frozen=True)
class Seen:
    """The detections of one person: share of each camera's pictures, and the median and 95th percentile of the limb
    joints' distances [px]."""

    shares: tuple[float, ...]
    median: float
    most: float


def filmed(
    body: Body, motions: Sequence[np.ndarray], cameras: Sequence[Camera], seed: int, work: Path
) -> dict[str, Films]:
    """Films of both people together, and of each alone, by camera. Both are rendered in the same room; together each
    pixel shows the nearer person, and elsewhere the darker one of the two pictures: the shadows of both."""
    points = np.array([body.landmarks(body.at(pose)) for q in motions for pose in q])
    place, scene = place_of(points, 0.0), SceneSettings(background="room", noise=0.0)
    makers = [
        Renderer(body, cameras, np.random.default_rng(seed), scene, place, dress=partial(dressed, others=worn))
        for worn in (None, OTHERS)
    ]
    films: dict[str, Films] = {name: {} for name in (TOGETHER, *ALONE)}
    for c, camera in enumerate(cameras):
        rng = np.random.default_rng((seed, c))
        shown = list(_pictures(body, motions, makers, c, rng))
        for name, pictures in zip(films, zip(*shown, strict=True), strict=True):
            file = made_folder(work / name) / f"{camera.name}.mp4"
            films[name][camera.name] = write_film(file, iter(pictures), FPS, fine=True)
        tell(f"{camera.name}: rendered")
    return films


def _pictures(
    body: Body, motions: Sequence[np.ndarray], makers: Sequence[Renderer], c: int, rng: np.random.Generator
) -> Iterator[list[np.ndarray]]:
    """For each frame the picture of both, of the first and of the second alone, by one camera."""
    for poses in zip(*motions, strict=True):
        posed = [body.at(q) for q in poses]
        alone = [maker.frame(p, c, rng) for maker, p in zip(makers, posed, strict=True)]
        first, second = (maker.maps(p, c) for maker, p in zip(makers, posed, strict=True))
        both = np.minimum(*alone)
        before = first.mask & ~(second.mask & (second.depth < first.depth))
        both[before] = alone[0][before]
        both[second.mask & ~before] = alone[1][second.mask & ~before]
        yield [
            np.clip(np.round(picture + NOISE * rng.standard_normal(picture.shape)), 0, 255).astype(np.uint8)
            for picture in (both, *alone)
        ]


def seen(files: Mapping[str, Path], body: Body, motions: Sequence[np.ndarray], cameras: Sequence[Camera]) -> list[Seen]:
    """The detections of each of the people in keypoint files of MediaPipe's layout, by camera."""
    names = list(body.landmark_names)
    pairs = [(j, names.index(n)) for j, n in enumerate(FORMATS["mediapipe33"]) if n in names and n.endswith(LIMBS)]
    theirs, ours = (list(column) for column in zip(*pairs, strict=True))
    distances: list[list[np.ndarray]] = [[] for _ in motions]
    shown = np.zeros((len(cameras), len(motions[0]), len(motions)), dtype=bool)
    for c, camera in enumerate(cameras):
        frames = load_people(files[camera.name]).frames if camera.name in files else {}
        for t, people in enumerate(frames.values()):
            truth = [camera.project(body.landmarks(body.at(q[t])))[ours] for q in motions]
            for person in people:
                apart = [np.linalg.norm(person.points[theirs, :2] - points, axis=1) for points in truth]
                k = int(np.argmin([np.median(of) for of in apart]))
                if np.median(apart[k]) < NEAR * np.ptp(truth[k][:, 1]):
                    distances[k].append(apart[k])
                    shown[c, t, k] = True
    return [
        Seen(tuple(row.tolist()), *np.percentile(np.array(of or [np.full(1, np.nan)]), [50, 95]).tolist())
        for row, of in zip(shown.mean(axis=1).T, distances, strict=True)
    ]


def detected(films: Films, folder: Path) -> Films:
    """The keypoint files of those films in which a person is seen; existing ones are used."""
    files = {}
    for name, film in films.items():
        file = made_folder(folder) / f"{name}.json"
        with suppress(InputError):
            km.detect(film, out=file, overwrite=True)
            files[name] = file
        tell(f"{folder.name}, {name}: {'done' if name in files else 'no person is seen'}")
    return files


def main(*, frames: int = 60, seed: int = 0, work: Work = None, json: Json = None) -> None:
    """Print in how many of the pictures each person is seen, and how far off.

    Parameters
    ----------
    frames
        Of the films.
    seed
        Of the people's ways, the room and the noise.
    """
    body = Body(load_subject("human34"))
    with work_folder(work) as kept:
        motions = crossing(body, Clip(2, frames, seed, kept), np.random.default_rng((2, seed, 13)))
        cameras = room_cameras(REACHED + 0.6, SIZE)
        films = filmed(body, motions, cameras, seed, kept)
        files = {name: detected(of, kept / f"{name} keypoints") for name, of in films.items()}
    sights = {name: seen(of, body, motions, cameras) for name, of in files.items()}
    table = report.table(
        f"two people filmed by {len(cameras)} cameras, {frames} frames: of all pictures", "film", "person",
        *(f"seen by {c.name}" for c in cameras), "limb joints, median [px]", "95 %",
    )  # fmt: skip
    for name, of in sights.items():
        for k, sight in enumerate(of):
            if ALONE.get(name, k) == k:
                shares = (f"{share:.0%}" for share in sight.shares)
                table.add_row(name, str(k + 1), *shares, f"{sight.median:.1f}", f"{sight.most:.1f}")
    report.console().print(table)
    entries = {name: [asdict(s) for s in of] for name, of in sights.items()}
    save(json, {"measure": "everybody filmed", "seed": seed, "films": entries})
