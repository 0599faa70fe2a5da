"""Contact of a run's feet: events, stances and slides of a known walk, its file, its picture and the command."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from builders import body_of
from test_foot_contact import walk
from test_run_file import header, state_of, walk as random_walk

import kinemode as km
from estimator.runs.contact import Contact, contact_of_points
from estimator.runs.run_file import RunWriter
from humanoid.support.errors import InputError
from kinemode import __main__ as front
from viz.pictures.contact_plot import write_contact_plot

NAMES = ("left_heel", "left_big_toe", "right_heel", "right_big_toe")
FPS = 50.0


@pytest.fixture(scope="module")
def walked() -> tuple[Contact, np.ndarray]:
    points, time, stands = walk(FPS, 0.0)
    return contact_of_points(time, NAMES, points), stands


def test_events_are_when_feet_begin_and_cease_to_stand(walked: tuple[Contact, np.ndarray]) -> None:
    contact, stands = walked
    for k, side in enumerate(("left", "right")):
        changes = np.flatnonzero(np.diff(stands[:, k].astype(int)))
        events = [event for event in contact.events if event.side == side]
        assert [event.kind for event in events] == ["strike" if stands[i + 1, k] else "off" for i in changes]
        expected = 0.5 * (contact.time[changes] + contact.time[changes + 1])
        np.testing.assert_allclose([event.time for event in events], expected, atol=0.09)
        assert all(abs(contact.time[event.frame] - event.time) <= 0.5 / FPS + 1e-9 for event in events)


def test_a_slide_is_how_far_what_stands_moves(walked: tuple[Contact, np.ndarray]) -> None:
    """With a drift of 20 mm/s a stance reaches 10 mm/s times its duration from the middle of its positions."""
    contact, _ = walked
    whole = [s for s in contact.stances if s.begin > contact.time[0] and s.end < contact.time[-1]]
    still = {(s.point, s.begin): s for s in whole}
    drift = contact.points + 0.02 * contact.time[:, None, None] * np.array([0.0, 1.0, 0.0])
    assert len(whole) >= 4
    for stance in replace(contact, points=drift).stances:
        if (before := still.get((stance.point, stance.begin))) is not None:
            drifted = 0.5 * 0.02 * (stance.end - stance.begin)
            assert abs(stance.slide - before.slide) <= drifted + 1e-9
            assert stance.slide >= drifted - 1e-9


def test_one_foot_alone_and_no_feet_at_all(walked: tuple[Contact, np.ndarray]) -> None:
    contact, _ = walked
    alone = contact_of_points(contact.time, NAMES[2:], contact.points[:, 2:])
    assert {event.side for event in alone.events} == {"right"}
    assert "left" not in repr(alone)
    nothing = contact_of_points(contact.time, NAMES, np.full_like(contact.points, np.nan))
    assert nothing.floor is None
    assert np.isnan(nothing.heights).all()
    assert nothing.stances == nothing.events == []


def test_the_file_has_the_documented_columns(walked: tuple[Contact, np.ndarray], tmp_path: Path) -> None:
    contact, _ = walked
    rows = list(csv.DictReader(contact.write(tmp_path / "c.csv").open()))
    for k, name in enumerate(NAMES):
        np.testing.assert_allclose([float(r[f"{name} stands"]) for r in rows], contact.standing[:, k], rtol=1e-5)
        np.testing.assert_allclose([float(r[f"{name} height [m]"]) for r in rows], contact.heights[:, k], atol=1e-6)
    with pytest.raises(InputError, match="cannot be written"):
        contact.write(tmp_path / "missing" / "c.csv")


def test_the_picture_has_both_feet(walked: tuple[Contact, np.ndarray], tmp_path: Path) -> None:
    drawn = cv2.imread(str(write_contact_plot(walked[0], tmp_path / "c.png")))
    assert drawn is not None
    for colour in ((178, 114, 0), (0, 94, 213)):
        assert (np.abs(drawn.astype(int) - colour).sum(axis=2) < 12).mean() > 0.02


@pytest.mark.parametrize("name", ["human34", "arm8"])
def test_the_command(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    body, path = body_of(name), tmp_path / "a.run"
    subject = header(6, subject_urdf=body.subject.urdf, subject_base=body.subject.base)
    with RunWriter.create(path, subject) as writer:
        for result in random_walk(body, 6):
            writer.append(result, state_of(result))
    code = front.main(["contact", str(path), "--out", str(tmp_path / "c.csv")])
    printed = capsys.readouterr()
    if name == "human34":
        assert code == 0
        assert "left_small_toe" in printed.out
        assert repr(km.contact(path)).startswith("<Contact: frames 6")
    else:
        assert code != 0
        assert "contact needs a person with feet" in printed.err
