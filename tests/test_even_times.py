"""Motions at even times, for formats and films of one rate."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from builders import body_of, random_pose
from made_runs import made_run
from test_viz import moving_scene

import kinemode as km
from estimator.runs.filtering import LONGEST, even_motion
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError


def steady(body: object, q0: np.ndarray, v: np.ndarray, time: np.ndarray) -> np.ndarray:
    return np.array([body.integrate(q0, v * t) for t in time])  # type: ignore[attr-defined]


SLOWER = np.concatenate([np.arange(30) / 30.0, 29.0 / 30.0 + np.arange(1, 16) / 15.0])
"""The second half of the clip at half the rate, as phones film in the dark."""


def test_a_steady_motion_is_read_off_at_even_times() -> None:
    """Joints and root turn at constant speed: exactly where they are then."""
    body, rng = body_of("human34"), np.random.default_rng(0)
    q0, v = random_pose(body, rng, share=0.3), 0.01 * rng.normal(size=body.nv)
    for time, rate in ((SLOWER + 3.0, 30.0), (np.delete(np.arange(40) / 25.0, [3, 17, 18]), 25.0)):
        seen = np.ones(len(time), dtype=bool)
        even = even_motion(body, steady(body, q0, v, time - time[0]), time, seen)
        np.testing.assert_allclose(even.time, time[0] + np.arange(len(even.time)) / rate, atol=1e-9)
        assert even.time[-1] == pytest.approx(time[-1])
        assert even.seen.all()
        apart = [body.difference(a, b) for a, b in zip(even.q, steady(body, q0, v, even.time - time[0]), strict=True)]
        assert np.abs(apart).max() < 1e-9
    assert len(even_motion(body, steady(body, q0, v, SLOWER), SLOWER, np.ones(45, dtype=bool)).time) == 60


def test_even_frames_stay_and_what_is_missing_is_not_made_up() -> None:
    body = body_of("arm8")
    q = np.tile(body.neutral, (45, 1))
    even = np.arange(45) / 29.97 + 1e-5 * np.sin(np.arange(45))
    same = even_motion(body, q, even, np.ones(45, dtype=bool))
    assert same.q is q
    q = q.copy()
    q[10], seen = np.nan, np.arange(45) != 20
    uneven = even_motion(body, q, SLOWER, seen)
    assert np.isnan(uneven.q[10]).all()
    assert np.isfinite(np.delete(uneven.q, 10, axis=0)).all()
    assert np.flatnonzero(~uneven.seen).tolist() == [10, 20]
    gap = np.concatenate([np.arange(10) / 30.0, 1.0 + np.arange(10) / 30.0])
    over = even_motion(body, q[-20:], gap, np.ones(20, dtype=bool))
    assert (over.time[~over.seen] > gap[9]).all()
    assert (over.time[~over.seen] < gap[10]).all()
    assert np.count_nonzero(~over.seen) == round((gap[10] - gap[9]) * 30.0) - 1
    assert gap[10] - gap[9] > LONGEST


def test_a_film_lasts_as_long_as_its_clip() -> None:
    """Pictures of the slower half are shown twice."""
    scene = moving_scene(45)
    object.__setattr__(scene, "time", SLOWER)
    pictures = [np.full((1, 1, 3), t, dtype=np.uint8) for t in range(45)]
    shown = [int(p[0, 0, 0]) for p in scene.paced(iter(pictures), range(45))]
    assert scene.rate == pytest.approx(30.0)
    assert len(shown) == 60
    assert shown == sorted(shown)
    assert [shown.count(t) for t in range(45)] == [1] * 29 + [2] * 15 + [1]
    object.__setattr__(scene, "time", np.arange(45) / 30.0)
    assert [int(p[0, 0, 0]) for p in scene.paced(iter(pictures), range(45))] == list(range(45))


def test_formats_of_one_rate_declare_it(tmp_path: Path) -> None:
    subject = load_subject("arm8")
    made = made_run(tmp_path / "a.run", subject, np.tile(body_of("arm8").neutral, (45, 1, 1)), times=SLOWER)
    with pytest.warns(km.InputWarning, match="not evenly spaced: bvh has poses between them, at 30 a second"):
        km.export(made, tmp_path / "a.bvh")
    assert "Frames: 60" in (tmp_path / "a.bvh").read_text()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        km.export(made, tmp_path / "a.csv")
    with pytest.raises(InputError, match="no export format 'xyz'"):
        km.export(made, tmp_path / "a.xyz")
