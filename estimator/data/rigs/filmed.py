"""The joints of a person that several cameras see, as rigs are found from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.keypoints import KeypointTrack
from estimator.data.rigs.first import FEWEST
from estimator.data.rigs.lengths import SegmentLengths
from estimator.data.rigs.views import JointView
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError

_FEWEST_JOINTS = 5  # that all cameras see
FILM = "film a person who walks to and fro, across and along, turns, and lifts the arms, for 20 s or more"
"""The data that determine where cameras stand."""


@dataclass(frozen=True)
class FilmedPerson:
    """names (C): of the cameras. joints (J): names of the landmarks used. views (C): of them."""

    names: list[str]
    joints: list[str]
    lengths: SegmentLengths
    views: list[JointView]

    @staticmethod
    def of(
        body: Body,
        tracks: Mapping[str, KeypointTrack],
        lenses: Mapping[str, Camera],
        times: Mapping[str, np.ndarray],
    ) -> FilmedPerson:
        """The filmed person from keypoints by camera; lenses: see `JointView`; times [s]: of the frames, by each
        camera's clock.

        Raises InputError: fewer than two cameras, a parallel one, too few joints or frames.
        """
        names = list(tracks)
        if len(names) < 2:
            raise InputError("cameras", "there is one: two or more are placed by a person", remedy="give clips of all")
        for name in names:
            lenses[name].needs_centre()
        lengths = SegmentLengths.of(body, _shared(tracks))
        joints = [body.landmark_names[i] for i in lengths.landmark]
        views = [_view(tracks[name], lenses[name], times[name], joints) for name in names]
        seen = FilmedPerson(names, joints, lengths, views)
        if len(joints) < _FEWEST_JOINTS or min(len(view.times) for view in views) < 2:
            raise seen.nothing()
        return seen

    def nothing(self) -> InputError:
        """The error that too little is seen by two cameras at once."""
        unseen = [name for name, view in zip(self.names, self.views, strict=True) if not np.isfinite(view.pixels).any()]
        if unseen:
            return InputError("cameras", f"no person is seen by {', '.join(unseen)}", remedy=f"leave it out, or {FILM}")
        problem = f"no two of {', '.join(self.names)} see {FEWEST} points of one person at once"
        remedy = f"the clips have to overlap in time and show the same person: {FILM}, in all of them at once"
        return InputError("cameras", problem, remedy=remedy)


def _shared(tracks: Mapping[str, KeypointTrack]) -> list[str]:
    """Names of the keypoints that all cameras have."""
    sets = [{name for name in track.names if name is not None} for track in tracks.values()]
    return sorted(set.intersection(*sets))


def _view(track: KeypointTrack, lens: Camera, times: np.ndarray, joints: Sequence[str]) -> JointView:
    seen = np.where((track.confidence > 0.0)[..., None], track.pixels, np.nan)
    columns = [track.names.index(name) for name in joints]
    return JointView(lens, seen[: len(times), columns], times[: len(seen)])
