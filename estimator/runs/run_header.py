"""The input of a run."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, cast

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.floor import OFF, KnownFloor
from estimator.data.formats.cameras_json import camera_from_json, camera_to_json, image_size
from estimator.data.formats.checked_json import LARGEST, mapping, member, number_between, numbers, sequence, shaped
from estimator.tracking.registry import TRACKERS, stored_settings
from humanoid.support.errors import InputError

RETARGETED = "retarget"
"""The tracker's name in a run that was made from another motion."""


@dataclass(frozen=True)
class RunHeader:
    """The inputs that determine a run's result, and its origin.

    subject_urdf: the subject's whole URDF. subject_source: the name or path it was loaded by. subject_base: "free" or
    "fixed". cameras: in the order of the observations.
    clips: path of each camera's clip, None for keypoints alone.
    image_sizes: width, height [px] of each camera's images.
    times (T,): time of every instant to be tracked [s].
    tracker, settings (JSON values), seed, version: how it was tracked, and by which kinemode.
    notes: messages to the user. findings: those of them by which the finished run contradicts its subject or input;
    None while it is not finished, and in runs made before they were stored.
    cues: image cues that were used; none for keypoints alone.
    masks, backgrounds: by camera, path of its given masks and of its picture of the empty scene, where there are any.
    clip_frames: by camera, number of its clip's frame at each instant (T,), where that is not the instant's own number.
    stereo: by camera, the one to its right whose clip shows depth together with its own. depths: by camera, path of its
    depth pictures.
    R_upright_given (3, 3): rotation of the world of the given cameras, so that z points up in the run's world; None
    where it was not turned. contradicted: rows of tracked frames that the findings contradict. floor: the known floor,
    see `estimator.inference.ground`; None where it is found from the feet. points: files of points in space, in
    place of cameras, or of the motion that was followed; none where cameras see the body. request: what was
    requested, as arguments of the command line by flag; None in runs that do not store it.
    """

    subject_urdf: str
    subject_source: str
    subject_base: str
    cameras: tuple[Camera, ...]
    clips: Mapping[str, str | None]
    image_sizes: Mapping[str, tuple[int, int]]
    times: np.ndarray
    tracker: str
    settings: Mapping[str, Any]
    seed: int
    version: str
    notes: tuple[str, ...] = ()
    cues: tuple[str, ...] = ()
    masks: Mapping[str, str] = field(default_factory=dict)
    backgrounds: Mapping[str, str] = field(default_factory=dict)
    clip_frames: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    stereo: Mapping[str, str] = field(default_factory=dict)
    depths: Mapping[str, str] = field(default_factory=dict)
    findings: tuple[str, ...] | None = None
    R_upright_given: np.ndarray | None = None
    contradicted: tuple[int, ...] = ()
    floor: KnownFloor = None
    points: tuple[str, ...] = ()
    request: Mapping[str, tuple[str, ...]] | None = None

    @property
    def retargeted(self) -> bool:
        """Whether the motion was made from another one, by `kinemode.retarget`: nothing was tracked."""
        return self.tracker == RETARGETED

    def frames_of(self, camera: str) -> np.ndarray:
        """Number of a camera's clip frame at each instant (T,)."""
        return np.asarray(self.clip_frames.get(camera, range(len(self.times))), dtype=np.int64)

    @property
    def base(self) -> Literal["free", "fixed"]:
        """`subject_base` as `subject_from_text` takes it."""
        return cast(Literal["free", "fixed"], self.subject_base)

    def deciding(self) -> dict[str, Any]:
        """JSON values of everything the result depends on, by its name for users."""
        return {
            "subject": self.subject_urdf,
            "base": self.subject_base,
            "cameras": [camera_to_json(camera) for camera in self.cameras],
            "image sizes": {name: list(size) for name, size in self.image_sizes.items()},
            "frame times": np.asarray(self.times, dtype=np.float64).tolist(),
            "tracker": self.tracker,
            "settings": json.loads(json.dumps(dict(self.settings))),
            "seed": int(self.seed),
            "kinemode version": self.version,
            "cues": list(self.cues),
            "cameras with masks": sorted(self.masks),
            "cameras with a background": sorted(self.backgrounds),
            "stereo pairs": dict(self.stereo),
            "cameras with depth": sorted(self.depths),
            "frames of the clips": {name: list(frames) for name, frames in self.clip_frames.items()},
            _FLOOR: self.floor,
        }

    def differences(self, other: RunHeader) -> tuple[str, ...]:
        """Names of the entries that determine the result and differ between two headers."""
        mine, theirs = self.deciding(), other.deciding()
        names = [name for name in mine if name != "settings" and mine[name] != theirs[name]]
        a, b = self._settings(), other._settings()
        names += [
            f"setting {key!r} ({a.get(key)} here, {b.get(key)} there)"
            for key in sorted(a.keys() | b.keys())
            if a.get(key) != b.get(key)
        ]
        return tuple(names)

    def _settings(self) -> dict[str, Any]:
        """The settings as JSON values; of a tracker that is known here as they would be stored now."""
        stored = dict(self.settings)
        if self.tracker in TRACKERS:
            stored = stored_settings(self.tracker, stored)
        return dict(json.loads(json.dumps(stored)))

    def to_json(self) -> str:
        """The header as text; numbers keep their last bit."""
        extra: dict[str, Any] = {
            "subject_source": self.subject_source,
            "clips": dict(self.clips),
            "masks": dict(self.masks),
            "backgrounds": dict(self.backgrounds),
            "depths": dict(self.depths),
            "notes": list(self.notes),
        }
        extra |= {} if self.findings is None else {"findings": list(self.findings)}
        if self.contradicted:
            extra[_CONTRADICTED] = list(self.contradicted)
        extra |= {} if self.R_upright_given is None else {_TURN: self.R_upright_given.tolist()}
        extra |= {_POINTS: list(self.points)} if self.points else {}
        asked = self.request
        extra |= {} if asked is None else {_REQUEST: {name: list(words) for name, words in asked.items()}}
        return json.dumps(self.deciding() | extra)

    @staticmethod
    def from_json(text: str, source: str) -> RunHeader:
        """The header `to_json` wrote; `source` names the file in errors.

        Raises
        ------
        InputError: it is not such a header, or has impossible values.
        """
        try:
            entries = _Entries(mapping(json.loads(text), source, "header"), source)
        except (ValueError, RecursionError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(source, "is damaged: its header is not JSON") from None
        cameras = entries.list("cameras")
        points = entries.texts(_POINTS) if _POINTS in entries.value else ()
        return RunHeader(
            subject_urdf=entries.text("subject"),
            subject_source=entries.text("subject_source"),
            subject_base=entries.text("base", ("free", "fixed")),
            cameras=entries.distinct(
                (camera_from_json(c, source, f"cameras[{i}]") for i, c in enumerate(cameras)), needed=not points
            ),
            clips=entries.paths("clips", missing=True),
            image_sizes={
                name: image_size(size, source, f"image sizes, {name}")
                for name, size in entries.mapping("image sizes").items()
            },
            times=entries.times("frame times"),
            tracker=entries.text("tracker"),
            settings=entries.mapping("settings"),
            seed=entries.seed("seed"),
            version=entries.text("kinemode version"),
            notes=entries.texts("notes"),
            cues=entries.texts("cues"),  # headers written before there were cues have none
            masks=entries.paths("masks"),
            backgrounds=entries.paths("backgrounds"),
            stereo=entries.pairs("stereo pairs"),
            depths=entries.paths("depths"),
            clip_frames=entries.frame_numbers("frames of the clips"),
            findings=entries.texts("findings") if "findings" in entries.value else None,
            R_upright_given=entries.turn(_TURN) if _TURN in entries.value else None,
            contradicted=entries.rows(_CONTRADICTED) if _CONTRADICTED in entries.value else (),
            floor=entries.floor(_FLOOR) if _FLOOR in entries.value else None,
            points=points,
            request=entries.words(_REQUEST) if _REQUEST in entries.value else None,
        )


def with_findings(text: str, findings: Sequence[str], contradicted: Sequence[int] = ()) -> str:
    """A header's text with a run's findings, which are notes too, and the rows of frames that they contradict."""
    values = json.loads(text)
    values["notes"] = list(dict.fromkeys([*values["notes"], *findings]))
    values["findings"] = list(findings)
    values.pop(_CONTRADICTED, None)
    values |= {_CONTRADICTED: [int(t) for t in contradicted]} if len(contradicted) else {}
    return json.dumps(values)


_TURN, _CONTRADICTED, _FLOOR, _POINTS = "turn to upright", "contradicted frames", "floor", "points"
_REQUEST = "request"
# what headers of the first runs lack
_LATER = ("cues", "masks", "backgrounds", "frames of the clips", "stereo pairs", "depths")


@dataclass(frozen=True)
class _Entries:
    """The entries of a header, each checked on access; InputError names the entry."""

    value: Mapping[str, Any]
    source: str

    def _get(self, key: str, instead: Any) -> Any:
        return self.value.get(key, instead) if key in _LATER else member(self.value, key, self.source, "")

    def floor(self, key: str) -> KnownFloor:
        value = self.value[key]
        if value is None or value == OFF:
            return cast(KnownFloor, value)
        return number_between(value, -LARGEST, LARGEST, self.source, key)

    def mapping(self, key: str) -> Mapping[str, Any]:
        return mapping(self._get(key, {}), self.source, key)

    def list(self, key: str) -> list[Any]:
        return sequence(self._get(key, []), self.source, key)

    def text(self, key: str, choices: Collection[str] = ()) -> str:
        text = self._get(key, None)
        if not isinstance(text, str) or (choices and text not in choices):
            remedy = f"one of {', '.join(choices)}" if choices else ""
            raise InputError(self.source, "is damaged: a text is needed", place=key, remedy=remedy)
        return text

    def texts(self, key: str) -> tuple[str, ...]:
        texts = self.list(key)
        if not all(isinstance(text, str) for text in texts):
            raise InputError(self.source, "is damaged: texts are needed", place=key)
        return tuple(texts)

    def paths(self, key: str, *, missing: bool = False) -> dict[str, Any]:
        paths = self.mapping(key)
        given = [path for path in paths.values() if not (missing and path is None)]
        if not all(isinstance(path, str) and "\0" not in path for path in given):
            raise InputError(self.source, "is damaged: file names are needed", place=key)
        return dict(paths)

    def words(self, key: str) -> dict[str, tuple[str, ...]]:
        """Texts by name."""
        by_name = self.mapping(key)
        if not all(isinstance(w, list) and all(isinstance(text, str) for text in w) for w in by_name.values()):
            raise InputError(self.source, "is damaged: texts by option are needed", place=key)
        return {name: tuple(words) for name, words in by_name.items()}

    def pairs(self, key: str) -> dict[str, str]:
        pairs, cameras = self.mapping(key), [c.get("name") for c in self.list("cameras") if isinstance(c, Mapping)]
        if not all(name in cameras for pair in pairs.items() for name in pair):
            raise InputError(self.source, "is damaged: names of cameras are needed", place=key)
        return dict(pairs)

    def frame_numbers(self, key: str) -> dict[str, tuple[int, ...]]:
        by_camera = {name: numbers(value, self.source, f"{key}, {name}") for name, value in self.mapping(key).items()}
        for name, frames in by_camera.items():
            if frames.ndim != 1 or not ((frames >= 0) & (frames == np.floor(frames))).all():
                raise InputError(self.source, "is damaged: frame numbers are needed", place=f"{key}, {name}")
        return {name: tuple(int(i) for i in frames) for name, frames in by_camera.items()}

    def rows(self, key: str) -> tuple[int, ...]:
        rows = numbers(self._get(key, []), self.source, key)
        if rows.ndim != 1 or not ((rows >= 0) & (rows == np.floor(rows))).all():
            raise InputError(self.source, "is damaged: frame numbers are needed", place=key)
        return tuple(int(row) for row in rows)

    def times(self, key: str) -> np.ndarray:
        times = numbers(self._get(key, []), self.source, key)
        if times.ndim != 1 or not (np.diff(times) > 0.0).all():
            raise InputError(self.source, "is damaged: rising times are needed", place=key)
        return times

    def turn(self, key: str) -> np.ndarray:
        R = shaped(self._get(key, None), (3, 3), self.source, key)
        if not np.allclose(R @ R.T, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0.0:
            raise InputError(self.source, "is damaged: a rotation is needed", place=key)
        return R

    def seed(self, key: str) -> int:
        seed = self._get(key, None)
        if type(seed) is not int or seed < 0:
            raise InputError(self.source, "is damaged: a whole number from 0 is needed", place=key)
        return seed

    def distinct(self, cameras: Iterable[Camera], *, needed: bool) -> tuple[Camera, ...]:
        distinct = tuple(cameras)
        if (needed and not distinct) or len({camera.name for camera in distinct}) < len(distinct):
            raise InputError(self.source, "is damaged: cameras of different names are needed", place="cameras")
        return distinct
