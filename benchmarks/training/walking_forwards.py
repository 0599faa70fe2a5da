"""How much rather people move forwards than backwards.

    python -m benchmarks walking_forwards

The setting `elmo.forwards` is rounded from this. A stretch is a movement along one's facing direction until it turns
back; it is one decision, however many frames it takes. People whose motions are sequences of `benchmarks.papers_elmo`
are left out.
"""

from __future__ import annotations

import numpy as np

from benchmarks.support.common import Data, Json, save
from benchmarks.support.pose_prior_clips import NO_CAPTURED_FILES, captured_files, subject_of
from estimator.synthesis.mocap import load_mocap
from estimator.synthesis.retarget import retarget
from humanoid.kinematics.body import ROOT_JOINT, Body
from humanoid.subject.subject import load_subject
from kinemode.terminal import report

STEP = 0.1  # s
LEAST = 0.1  # m: shorter stretches are sway
_WALKED = 1.0  # m: who moves less in all shows no preference
_TRACKED = ("02", "05", "26")  # people of the sequences of ELMO's measure


def main(*, data: Data = None, json: Json = None) -> None:
    """Measure how much rather captured people move forwards than backwards, in nats a metre."""
    files = captured_files(data)
    if not files:
        print(NO_CAPTURED_FILES)
        return
    body = Body(load_subject("human34"))
    people: dict[str, list[np.ndarray]] = {}
    for path in files:
        if subject_of(path.stem) not in _TRACKED:
            mocap = load_mocap(path)
            q = retarget(body, mocap, np.arange(0.0, mocap.seconds, STEP)).q
            people.setdefault(subject_of(path.stem), []).append(stretches(body, q))
    table = report.table("movements along the facing direction", "person", "forwards [m]", "backwards [m]")
    shares, backwards = [], []
    for who, listed in people.items():
        own = np.concatenate(listed)
        ahead, back = own[own > 0.0].sum(), -own[own < 0.0].sum()
        table.add_row(who, f"{ahead:.1f}", f"{abs(back):.1f}")
        if ahead + back > _WALKED:
            shares.append(back / (ahead + back))
            backwards.append(-own[own < 0.0])
    share, length = float(np.mean(shares)), float(np.mean(np.concatenate(backwards)))
    nats = float(np.log((1.0 - share) / share) / length)
    out = report.console()
    out.print(table)
    out.print(f"{share:.1%} backwards, the mean over people, in stretches of {length:.2f} m: {nats:.1f} nats a metre.")
    save(json, {"measure": "walking_forwards", "share": share, "length": length, "nats": nats})


def stretches(body: Body, q: np.ndarray) -> np.ndarray:
    """Lengths (S,) [m] of a motion's (T, nq) stretches along its facing direction, level, negative backwards."""
    ahead = body.placed(q).placements[:, ROOT_JOINT, :2]
    ahead = ahead / np.linalg.norm(ahead, axis=1)[:, None]
    along = np.einsum("ti,ti->t", np.diff(q[:, :2], axis=0), ahead[:-1])
    number = np.cumsum(np.concatenate([[False], np.sign(along[1:]) != np.sign(along[:-1])]))
    lengths = np.bincount(number, along)
    return np.asarray(lengths[np.abs(lengths) > LEAST])
