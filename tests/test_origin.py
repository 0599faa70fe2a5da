"""Where modes came from: as records, as arrays of a run file, and under older names."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest

from estimator.inference.mixture import MODE_FIELDS, Mode, mode_arrays, modes_of
from estimator.inference.origin import ORIGIN_FIELDS, Family, Origin, Origins, PreviousPose, families
from estimator.trackers.frame_result import RESULT_FIELDS, FrameResult

Q, AHEAD = np.array([0.1, 0.2]), np.array([0.3, 0.4])
KINDS = [
    Origin(Family.START),
    Origin(Family.KEPT, PreviousPose(Q, AHEAD)),
    Origin(Family.ASSOCIATION, PreviousPose(Q)),
    Origin(Family.SAMPLE, PreviousPose(Q, has_transition=False)),
    Origin(Family.DEPTH_JUMP, PreviousPose(AHEAD, q_left=Q), 6.0),
]


def test_origins_survive_storing() -> None:
    """Fields that do not apply are absent: no pose before the first frame, no penalty in a static search."""
    origins = Origins.of(KINDS, nq=2)
    assert origins is not None
    read = Origins.from_arrays(origins.arrays(), nq=2)
    assert read is not None
    for k, origin in enumerate(KINDS):
        again = read.of_mode(k)
        assert again.family is origin.family
        assert again.penalty == origin.penalty
        assert (again.previous is None) == (origin.previous is None)
        if again.previous is not None and origin.previous is not None:
            assert again.previous.key == origin.previous.key
            assert again.previous.has_transition == origin.previous.has_transition
    transitions = [origin.transition_from for origin in map(read.of_mode, range(len(KINDS)))]
    assert transitions[0] is None
    assert transitions[3] is None
    assert np.array_equal(np.array([transitions[1], transitions[2], transitions[4]]), [Q, Q, AHEAD])
    assert Origins.of([*KINDS, None], nq=2) is None


def test_runs_keep_their_names_and_old_names_are_read() -> None:
    """The constant penalty is stored as before; families had other names."""
    origins = Origins.of(KINDS, nq=2)
    assert origins is not None
    stored = origins.arrays()
    assert set(stored) == {f"origin_{n}" for n in ("family", "q_previous", "q_predicted", "paid", "price", "q_left")}
    stored["origin_family"] = np.array(["start", "parent", "other reading", "sample", "jump in depth"])
    del stored["origin_q_left"]
    old = Origins.from_arrays(stored, nq=2)
    assert old is not None
    assert [old.of_mode(k).family for k in range(5)] == [origin.family for origin in KINDS]
    assert np.array_equal(np.asarray(families(stored)), origins.family)
    assert families({}) is None
    with pytest.raises(ValueError, match="'x'"):
        families({"origin_family": np.array(["x"])})


def test_every_field_of_a_hypothesis_is_in_the_file_table() -> None:
    renamed = {"paid": "has_transition", "price": "penalty"}
    assert {f.name for f in fields(Mode)} - {"origin"} == set(MODE_FIELDS)
    of_the_frame = {"index", "time", "status", "origins", "extra"}
    assert {f.name for f in fields(FrameResult)} - of_the_frame == set(RESULT_FIELDS)
    assert [f.name for f in fields(Origins)] == [renamed.get(name, name) for name in ORIGIN_FIELDS]
    mode = Mode(np.arange(3.0), np.eye(2), 1.5, "converged", np.ones(2), 1e-9, 0.01, 4, "exchanged")
    (again,) = modes_of(mode_arrays([mode]))
    assert all(np.array_equal(getattr(again, name), getattr(mode, name)) for name in MODE_FIELDS)
