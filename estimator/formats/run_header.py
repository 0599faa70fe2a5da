"""What a run was made from."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, cast

import numpy as np

from estimator.formats.cameras import camera_from_json, camera_to_json
from estimator.imaging.camera import Camera


@dataclass(frozen=True)
class RunHeader:
    """What decides a run's result, and where it came from.

    subject_urdf: the subject's whole URDF. subject_source: what it was asked for. subject_base: "free" or "fixed".
    cameras: in the order of the observations.
    clips: path of each camera's clip, None for keypoints alone.
    image_sizes: width, height [px] of each camera's images.
    times (T,): time of every instant that is to be tracked [s].
    tracker, settings (JSON values), seed, version: how it was tracked, and by which kinemode.
    notes: what the user was told.
    cues: which of the pictures' cues were looked at; none for keypoints alone.
    masks, backgrounds: by camera, path of its given masks and of its picture of the empty scene, where there are any.
    clip_frames: by camera, number of its clip's frame at each instant (T,), where that is not the instant's own number.
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

    def frames_of(self, camera: str) -> np.ndarray:
        """Number of a camera's clip frame at each instant (T,)."""
        return np.asarray(self.clip_frames.get(camera, range(len(self.times))), dtype=np.int64)

    @property
    def base(self) -> Literal["free", "fixed"]:
        """`subject_base` as `subject_from_text` takes it."""
        return cast(Literal["free", "fixed"], self.subject_base)

    def deciding(self) -> dict[str, Any]:
        """JSON values of everything the result depends on, by the name a user knows it by."""
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
            "frames of the clips": {name: list(frames) for name, frames in self.clip_frames.items()},
        }

    def differences(self, other: RunHeader) -> tuple[str, ...]:
        """Names of what decides the result and differs between two headers."""
        mine, theirs = self.deciding(), other.deciding()
        names = [name for name in mine if name != "settings" and mine[name] != theirs[name]]
        a, b = mine["settings"], theirs["settings"]
        names += [
            f"setting {key!r} ({a.get(key)} here, {b.get(key)} there)"
            for key in sorted(a.keys() | b.keys())
            if a.get(key) != b.get(key)
        ]
        return tuple(names)

    def to_json(self) -> str:
        """The header as text; numbers keep their last bit."""
        extra = {
            "subject_source": self.subject_source,
            "clips": dict(self.clips),
            "masks": dict(self.masks),
            "backgrounds": dict(self.backgrounds),
            "notes": list(self.notes),
        }
        return json.dumps(self.deciding() | extra)

    @staticmethod
    def from_json(text: str, source: str) -> RunHeader:
        """The header `to_json` wrote; `source` names the file in errors."""
        v = json.loads(text)
        return RunHeader(
            subject_urdf=v["subject"],
            subject_source=v["subject_source"],
            subject_base=v["base"],
            cameras=tuple(camera_from_json(c, source, f"cameras[{i}]") for i, c in enumerate(v["cameras"])),
            clips=v["clips"],
            image_sizes={name: (int(w), int(h)) for name, (w, h) in v["image sizes"].items()},
            times=np.array(v["frame times"], dtype=np.float64),
            tracker=v["tracker"],
            settings=v["settings"],
            seed=v["seed"],
            version=v["kinemode version"],
            notes=tuple(v["notes"]),
            cues=tuple(v.get("cues", ())),  # headers written before there were cues have none
            masks=v.get("masks", {}),
            backgrounds=v.get("backgrounds", {}),
            clip_frames={name: tuple(int(i) for i in f) for name, f in v.get("frames of the clips", {}).items()},
        )


def with_notes(text: str, notes: Sequence[str]) -> str:
    """A header's text with more notes, those left out that it has."""
    values = json.loads(text)
    values["notes"] = list(dict.fromkeys([*values["notes"], *notes]))
    return json.dumps(values)
