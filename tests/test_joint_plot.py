"""Plots of joints: which are shown, what is drawn of them, and the files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from builders import body_of
from made_runs import made_run
from matplotlib.colors import to_hex
from test_evaluation import robot
from test_joint_angles import poses

import kinemode as km
from estimator.runs.run_reader import Run
from humanoid.support.errors import InputError
from kinemode.__main__ import main
from viz.palette import ON_PAPER, web
from viz.pictures.joint_plot import chosen_joints, drawn, panels_of, write_joint_plot
from viz.solids.solid import without_side

HUMAN = body_of("human34").q_names[7:]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    body = robot()
    t = np.arange(12)
    steps = np.stack([0.15 * t, 0.1 * t, 0.02 * t], axis=1)
    q = np.stack([poses(body, steps), poses(body, steps + 0.1)], axis=1)
    status = ["tracked"] * 4 + ["hard"] * 2 + ["tracked"] * 3 + ["unobserved"] * 3
    return made_run(tmp_path_factory.mktemp("plot") / "a.run", body.subject, q, weight=(0.6, 0.4), status=status)


def test_joints_are_selected_by_names_parts_and_sides() -> None:
    usual = chosen_joints(HUMAN, None)
    assert {without_side(name) for name in usual} == {
        "hip_flexion", "hip_abduction", "hip_rotation", "knee_flexion", "ankle_dorsiflexion", "shoulder_elevation",
        "shoulder_flexion", "shoulder_rotation", "elbow_flexion",
    }  # fmt: skip
    assert chosen_joints(("bend", "spin", "lift"), None) == ("bend", "spin", "lift")
    assert chosen_joints(HUMAN, "right knee, left_elbow_flexion") == ("left_elbow_flexion", "right_knee_flexion")
    assert chosen_joints(HUMAN, ["knee", "Neck_Axial"]) == ("left_knee_flexion", "neck_axial", "right_knee_flexion")
    assert chosen_joints(HUMAN, "left") == tuple(name for name in HUMAN if name.startswith("left_"))
    assert chosen_joints(("bend", "bend_more"), "bend") == ("bend",)  # a whole name is that joint alone
    with pytest.raises(InputError, match=r"no joint is called 'kneee' .did you mean left_knee_flexion or right_knee"):
        chosen_joints(HUMAN, "hip,kneee")
    with pytest.raises(InputError, match="joints: names no joint"):
        chosen_joints(HUMAN, " , ")


@pytest.mark.parametrize(
    ("name", "bare"),
    [
        ("left_hip_flexion", "hip_flexion"), ("l_hip", "hip"), ("hip_L", "hip"), ("arm_right_1_joint", "arm_1_joint"),
        ("RightKnee", "Knee"), ("lumbar", "lumbar"), ("left", "left"), ("roll", "roll"),
    ],
)  # fmt: skip
def test_sides_are_taken_off_names(name: str, bare: str) -> None:
    assert without_side(name) == bare


def test_left_and_right_share_a_panel(tmp_path: Path) -> None:
    body = body_of("human34")
    person = made_run(tmp_path / "p.run", body.subject, np.tile(body.neutral, (3, 1, 1)))
    panels = panels_of([person[name].degrees for name in chosen_joints(HUMAN, "knee,neck_axial")])
    assert [(panel.title, [side for side, _ in panel.curves]) for panel in panels] == [
        ("knee_flexion", ["left", "right"]), ("neck_axial", ["trunk"]),
    ]  # fmt: skip
    axes = drawn(person, panels).axes[0]
    colours = {to_hex(line.get_color()) for line in axes.get_lines() if len(line.get_xdata()) == 3}
    assert colours == {web(ON_PAPER["left"]), web(ON_PAPER["right"])}


def test_what_is_drawn_is_what_the_run_has(run: Run) -> None:
    angles = [run[name].degrees for name in run.joint_names]
    bend = angles[0]
    figure = drawn(run, panels_of(angles))
    first, _, third = figure.axes
    curve = next(line for line in first.get_lines() if len(line.get_xdata()) == len(run))
    np.testing.assert_allclose(curve.get_ydata(), bend.value)
    band, others = (c for c in first.collections if len(c.get_paths()))
    if len(band.get_paths()) > 1:
        band, others = others, band
    corners = band.get_paths()[0].vertices
    for t in (0, 6, 11):
        here = corners[np.isclose(corners[:, 0], run.time[t]), 1]
        assert (here.min(), here.max()) == pytest.approx((bend.low[t], bend.high[t]))
    ends = np.array([path.vertices[-1] for path in others.get_paths()])  # of the second hypothesis, from frame to frame
    np.testing.assert_allclose(ends, np.stack([run.time, bend.hypotheses[:, 1]], axis=1))
    spans = sorted(tuple(np.round(patch.get_extents().transformed(first.transData.inverted()).intervalx * 30.0, 6))
                   for patch in first.patches)  # fmt: skip
    assert spans == [(3.5, 5.5), (8.5, 11.5)]
    limits = [line.get_ydata()[0] for line in first.get_lines() if len(line.get_xdata()) == 2]
    assert limits == pytest.approx([np.rad2deg(2.0)])  # the lower one is far
    assert (first.get_ylabel(), third.get_ylabel()) == ("degrees", "metres")
    labels = {text.get_text() for text in figure.legends[0].get_texts()}
    assert labels == {
        "best hypothesis",
        "90 % interval",
        "other hypotheses",
        "joint limit",
        "hard frames",
        "unobserved frames",
    }


def test_the_ending_decides_the_format(run: Run, tmp_path: Path) -> None:
    starts = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    for kind, start in starts.items():
        path = km.plot(run, tmp_path / f"a.{kind}", joints=["bend"])
        again = tmp_path / f"b.{kind}"
        assert main(["plot", str(run.file), "--joints", "bend", "--out", str(again)]) == 0
        assert path.read_bytes() == again.read_bytes()
        assert path.read_bytes().startswith(start)
    assert main(["plot", str(run.file), "--filter", "5", "--out", str(tmp_path / "d.png")]) == 0
    with pytest.raises(InputError, match=r"a.gif: is not a picture file .let it end in .png, .svg, .pdf"):
        km.plot(run, tmp_path / "a.gif")
    for argument in ({"joints": 3}, {"filter": "6"}):
        with pytest.raises(InputError, match="cannot be of type"):
            km.plot(run, tmp_path / "e.png", **argument)  # type: ignore[arg-type]
    assert not (tmp_path / "e.png").exists()


def test_a_run_without_a_pose_has_no_plot(tmp_path: Path) -> None:
    body = robot()
    empty = made_run(tmp_path / "a.run", body.subject, np.full((2, 1, body.nq), np.nan), status=["unobserved"] * 2)
    with pytest.raises(InputError, match=r"a.run: contains no poses"):
        write_joint_plot(empty, tmp_path / "a.png")
    assert len(empty["bend"].value) == 2
    assert np.isnan(empty.butterworth(5.0).q).all()
