"""Ranks of true joint angles in the posterior of a tracker (`kinemode.testing.check_calibration`), of poses that the
prior on rest positions expects, and of poses anywhere within the limits.

The body and the size of the detector's noise are known. Poses of the first kind are drawn from Gaussians with the
stabilisers' rests and deviations, cut off at the limits, and held; the others move.
"""

from __future__ import annotations

import itertools

import numpy as np

from benchmarks.support.common import Json, save
from estimator.runs.posterior import PosteriorCalibration
from estimator.synthesis.settings import ViewSettings
from estimator.synthesis.views import framing_cameras
from estimator.tracking.registry import make_tracker
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report
from kinemode.testing import check_calibration, simulated_clips

CHANCE = 1e-3
AT_REST, ANYWHERE = "from the prior", "within the limits"


def pose_at_rest(body: Body, rng: np.random.Generator) -> np.ndarray:
    """A pose (nq,) from the prior on rest positions; joints without one, and a free root, are at rest."""
    q = body.neutral.copy()
    for stabiliser in body.subject.stabilisers:
        i = body.model.idx_qs[body.model.getJointId(stabiliser.joint)]
        q[i] = np.inf
        while not body.lower[i] <= q[i] <= body.upper[i]:
            q[i] = stabiliser.rest + stabiliser.std * rng.normal()
    return q


def main(
    *,
    subject: str = "human34",
    tracker: str = "css",
    clips: int = 100,
    frames: int = 3,
    noise: float = 2.5,
    bias: float = PosteriorCalibration().landmark_std,
    seed: int = 0,
    json: Json = None,
) -> None:
    """Track short simulated clips by one camera and by two, and print how uniform the ranks of the true angles are.

    Parameters
    ----------
    subject
        A built-in name or a URDF file.
    tracker
        As in `kinemode track`.
    clips
        How many of each kind; the last frame of each counts.
    frames
        Of each clip.
    noise
        Standard deviation of the keypoints [px].
    bias
        Of the detector [m], see `DetectorSettings`.
    seed
        Of motions, noise, tracker and samples.
    """
    body = Body(load_subject(subject))
    points = body.landmarks(body.at(body.neutral))[None]
    columns = ("50 %", "90 %", "error", "largest deviation", "band", "joints beyond it")
    made = report.table(f"ranks of {clips} truths, {tracker}, {subject}, {noise:g} px", "poses, cameras", *columns)
    figures, worst = {}, []
    motions = {AT_REST: lambda times, rng: np.tile(pose_at_rest(body, rng), (len(times), 1)), ANYWHERE: None}
    for (kind, motion), count in itertools.product(motions.items(), (1, 2)):
        cameras = framing_cameras(points, ViewSettings(count=count, fill=0.6))
        drawn = simulated_clips(
            body, cameras, clips, motion=motion, frames=frames, noise_px=noise, bias=bias, seed=seed
        )
        ranks = check_calibration(lambda: make_tracker(tracker, body), drawn, band=1.0, seed=seed)
        (half, most), off, band = ranks.coverage(np.array([0.5, 0.9])), ranks.deviation, ranks.band(CHANCE)
        name, beyond = f"{kind}, {count}", int(np.sum(off > band))
        figures[name] = {
            "50 %": half, "90 %": most, "error": ranks.calibration_error, "deviation": off.max(), "band": band,
            "beyond": beyond,
        }  # fmt: skip
        shares = f"{half:.1%}", f"{most:.1%}", f"{ranks.calibration_error:.3f}"
        made.add_row(name, *shares, f"{off.max():.2f}", f"{band:.2f}", f"{beyond} of {len(ranks.names)}")
        worst.append(f"{name}: {ranks.worst()}")
    report.console().print(made)
    report.print_lines(worst)
    save(json, {"measure": "calibration_ranks", "clips": clips, "found": figures})
