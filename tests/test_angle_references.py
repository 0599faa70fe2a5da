"""Joint angles of other programs as references: known differences, in every kind of file."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from builders import body_of, random_pose
from made_runs import made_run

import kinemode as km
from estimator.data.formats.opensim import read_mot, write_mot
from estimator.runs.coordinate_errors import JointScore, common_times, values_at
from estimator.runs.evaluation import Evaluation
from estimator.runs.run_reader import Run
from humanoid.support.errors import InputError
from kinemode.terminal import report

SHIFT = {"knee_angle_l": 3.0, "hip_flexion_r": -7.5, "ankle_angle_r": 0.25, "arm_flex_l": 200.0}  # [deg] run less file
UNMEASURED = {f"{name}_{side}" for name in ("subtalar_angle", "mtp_angle", "pro_sup", "wrist_flex", "wrist_dev",
                                            "knee_angle_{}_beta") for side in "rl"}  # fmt: skip


@pytest.fixture(params=[1, 2], scope="module")
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A person moving through random poses along straight lines."""
    body, rng = body_of("human34"), np.random.default_rng(request.param)
    ends = [random_pose(body, rng) for _ in range(3)]
    q = [pin.interpolate(body.model, a, b, s) for a, b in pairwise(ends) for s in np.linspace(0, 1, 12)]
    return made_run(tmp_path_factory.mktemp("angles") / "a.run", body.subject, np.array(q)[:, None])


def shifted(run: Run, path: Path) -> tuple[Path, dict[str, np.ndarray]]:
    """The run as Rajagopal's coordinates, with known shifts and noise (T,) [deg], which has no mean."""
    (names, values, _), time = read_mot(km.export(run, path, format="rajagopal-mot"))
    noise = {name: np.random.default_rng(k).normal(0.0, 1.5, len(time)) for k, name in enumerate(SHIFT)}
    noise = {name: x - x.mean() for name, x in noise.items()}
    values = values - np.stack([SHIFT.get(name, 0.0) + noise.get(name, 0.0 * time) for name in names], axis=1)
    write_mot(path, names, values, time, title="shifted")
    return path, noise


def same_numbers(mot: Path, folder: Path) -> dict[str, Path]:
    """The same angles as states of OpenSim 4 in radians, and as csv of both units."""
    (names, values, _), time = read_mot(mot)
    length = np.array([name[-3:] in ("_tx", "_ty", "_tz") for name in names])
    radians = np.where(length, values, np.deg2rad(values))
    files = {kind: folder / f"{kind}.{kind[:3]}" for kind in ("sto", "csv", "csv_said", "csv_each")}
    paths = [f"/jointset/joint/{name}/{what}" for name in names for what in ("value", "speed")]
    states = np.stack([radians, 0.0 * radians + 9.0], axis=2).reshape(len(time), -1)
    head = "states\ninDegrees=no\nendheader\n"
    files["sto"].write_text(head + table("\t", ["time", *paths, "/forceset/a/activation"], time, np.c_[states, time]))
    files["csv"].write_text(table(",", ["time", *names], time, values))
    files["csv_said"].write_text("# inDegrees = no\n" + table(",", ["time", *names], time, radians))
    units = [f"{name}_{'m' if slides else 'rad'}" for name, slides in zip(names, length, strict=True)]
    files["csv_each"].write_text(table(",", ["time_s", *units], time, radians))
    return files


def table(between: str, names: list[str], time: np.ndarray, values: np.ndarray) -> str:
    rows = [names, *([repr(float(x)) for x in row] for row in np.c_[time, values])]
    return "\n".join(between.join(row) for row in rows) + "\n"


def test_known_shifts_and_noise_are_the_errors(run: Run, tmp_path: Path) -> None:
    path, noise = shifted(run, tmp_path / "a.mot")
    result = km.evaluate(run, path)
    scores = result.joint_scores
    for name, score in scores.items():
        off, rest = SHIFT.get(name, 0.0), noise.get(name, np.zeros(len(run)))
        wrapped = (off + rest + 180.0) % 360.0 - 180.0
        assert score.frames == len(run)
        assert score.bias == pytest.approx((off + 180.0) % 360.0 - 180.0, abs=1e-6), name
        expected = [np.abs(wrapped).mean(), np.abs(rest).mean()]
        assert [score.mean_absolute, score.mean_absolute_without_bias] == pytest.approx(expected, abs=1e-6)
        expected = [np.sqrt(np.mean(x**2)) for x in (wrapped, rest)]
        assert [score.rms, score.rms_without_bias] == pytest.approx(expected, abs=1e-6)
    assert scores.keys() >= SHIFT.keys() | {"pelvis_tilt", "lumbar_extension", "pelvis_tx"}
    assert not {name.split("_beta")[0] for name in scores if "beta" in name or name in UNMEASURED}
    groups = result.group_scores
    assert groups["knees"].mean_absolute == pytest.approx(0.5 * scores["knee_angle_l"].mean_absolute, abs=1e-6)
    joints = [s.rms for name, s in scores.items() if s.unit == "deg" and not name.startswith("pelvis_")]
    assert groups["all"].rms == pytest.approx(np.mean(joints))
    of_legs = [scores[f"{n}_{s}"].rms_without_bias for s in "lr" for n in ("hip_flexion", "knee_angle", "ankle_angle")]
    assert groups["legs"].rms_without_bias == pytest.approx(np.mean(of_legs))
    assert "reference alone: subtalar_angle_r" in " ".join(result.notes)
    assert "bent knees are positive in the reference: read as angles of Rajagopal2016" in result.notes


def test_every_kind_of_file_gives_the_same_scores(run: Run, tmp_path: Path) -> None:
    path, _ = shifted(run, tmp_path / "a.mot")
    reference = numbers(km.evaluate(run, path))
    for kind, file in same_numbers(path, tmp_path).items():
        same = numbers(km.evaluate(run, file))
        assert same.keys() == reference.keys(), kind
        for name, values in reference.items():
            np.testing.assert_allclose(same[name], values, atol=1e-9, rtol=0.0, err_msg=f"{kind} {name}")


def numbers(result: Evaluation) -> dict[str, tuple[float, ...]]:
    return {n: (s.mean_absolute, s.rms, s.bias, s.rms_without_bias) for n, s in result.joint_scores.items()}


def test_the_sign_of_bent_knees_identifies_the_gait_model(run: Run, tmp_path: Path) -> None:
    result = km.evaluate(run, km.export(run, tmp_path / "a.mot", format="gait2392-mot"))
    assert max(score.mean_absolute for score in result.joint_scores.values()) < 1e-6
    assert "bent knees are negative in the reference: read as angles of gait2392" in result.notes


@pytest.mark.parametrize("ending", ["mot", "csv", "npz"])
def test_our_own_exports_are_references(run: Run, tmp_path: Path, ending: str) -> None:
    result = km.evaluate(run, km.export(run, tmp_path / f"a.{ending}"))
    assert "left_knee_flexion" in result.joint_scores
    assert max(score.mean_absolute for score in result.joint_scores.values()) < 1e-6
    assert not result.notes


def test_times_are_matched_between_samples_and_not_across_gaps() -> None:
    time, fine = np.arange(0.0, 1.0, 0.1), np.arange(-0.5, 2.0, 0.04)
    assert common_times(time, fine) is time
    assert common_times(fine, time) is time
    straight = values_at(time, fine, 3.0 * fine, wraps=False)
    np.testing.assert_allclose(straight, 3.0 * time)
    gap = values_at(np.array([0.55, 0.65, 0.6, 0.75, 0.95]), time, np.where(time == time[6], np.nan, time), wraps=False)
    np.testing.assert_allclose(gap, [np.nan, np.nan, np.nan, 0.75, np.nan])
    turns = np.mod(100.0 * time, 2.0 * np.pi)  # jumps of a whole turn lie between samples
    between = values_at(time[:-1] + 0.05, time, np.mod(3.0 * time * np.pi, 2.0 * np.pi), wraps=True)
    np.testing.assert_allclose(np.exp(1j * between), np.exp(3j * np.pi * (time[:-1] + 0.05)))
    assert values_at(time, time + 4e-7, turns, wraps=False).tolist() == turns.tolist()  # times as files round them


def test_a_bias_near_half_a_turn_is_taken_away_whole() -> None:
    score = JointScore.of(np.array([179.0, -179.0, 178.0, -178.0]), "deg", wraps=True)
    assert abs(score.bias) == pytest.approx(180.0)
    assert (score.mean_absolute, score.mean_absolute_without_bias) == pytest.approx((178.5, 1.5))


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "time,knee_angle_r\n0,0.4\n1,0.5\n", r"a.csv: angles may be degrees or radians.*knee_angle_r"),
        ("a.csv", "time,knee_angle_r\n0,10\n1,x\n", r"line 3, column 'knee_angle_r': 'x' is not a number"),
        ("a.csv", "# inDegrees=maybe\ntime,knee_angle_r\n0,10\n1,2\n", r"line 1: inDegrees is 'maybe' \(yes or no\)"),
        ("a.csv", "time,knee_angle_r,knee_angle_r_deg\n0,9,9\n", "'knee_angle_r' appears twice"),
        ("a.csv", "time,status\n0,tracked\n", "has no coordinates"),
        ("a.mot", "endheader\ntime knee_angle_r\n0 10\n", r"header: does not declare whether.*line inDegrees=yes"),
        ("a.sto", "endheader\ntime /forceset/a/activation\n0 1\n", "has no coordinates"),
        ("a.sto", "inDegrees=no\nendheader\ntime /jointset/k/b/value b\n0 1 1\n", "the coordinate 'b' appears twice"),
        ("a.mot", "endheader\ntime ground_force_1_vx\n0 700\n", "shares no landmarks and no joint angles"),
    ],
)  # fmt: skip
def test_faults_are_named(run: Run, tmp_path: Path, name: str, text: str, message: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        km.evaluate(run, tmp_path / name)


def test_the_table_has_errors_with_and_without_the_bias(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = km.evaluate(run, shifted(run, tmp_path / "a.mot")[0])
    report.print_evaluation(result)
    rows = {line.split("  ")[1].strip(): line.split() for line in capsys.readouterr().out.splitlines() if "deg" in line}
    score = result.joint_scores["hip_flexion_r"]
    sizes = (score.mean_absolute, score.rms, score.bias, score.mean_absolute_without_bias, score.rms_without_bias)
    assert [float(cell) for cell in rows["hip_flexion_r"][1:-1:2]] == pytest.approx(sizes, abs=0.005)
    assert any(name.startswith("mean of legs") for name in rows)
