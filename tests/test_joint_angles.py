"""Joints of a run by name: their places, values, units, intervals and tables."""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from builders import MULTIPLIER, OFFSET, body_of
from made_runs import made_run
from scipy.optimize import brentq
from scipy.stats import norm
from test_evaluation import robot

import kinemode as km
from estimator.runs.posterior import PosteriorCalibration
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError

SPREAD = 0.05
APART = 0.5


def poses(body: Body, steps: np.ndarray) -> np.ndarray:
    """Configurations (T, nq) at steps (T, nv) from neutral."""
    return np.array([pin.integrate(body.model, body.neutral, step) for step in steps])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A robot with two equally likely hypotheses; its continuous joint passes half a turn; a frame is empty."""
    body = robot()
    t = np.arange(8)
    here = poses(body, np.stack([0.1 * t, 2.8 + 0.2 * t, 0.05 * t], axis=1))
    there = poses(body, np.stack([0.1 * t + APART, 3.0 + 0.2 * t, 0.05 * t], axis=1))
    q = np.stack([here, there], axis=1)
    q[5] = np.nan
    status = ["tracked"] * 5 + ["unobserved", "hard", "tracked"]
    file = tmp_path_factory.mktemp("angles") / "robot.run"
    return made_run(file, body.subject, q, weight=(0.5, 0.5), std=SPREAD, status=status)


def test_a_name_has_its_place_in_configurations_and_in_tangents() -> None:
    for body in (robot(), body_of("human34")):
        for name in {*body.q_names, *body.v_names} & set(body.q_names) & set(body.v_names):
            place = body.place(name)
            assert (body.q_names[place.q], body.v_names[place.v]) == ((name,), (name,))
    assert body_of("human34").place("root")[1:] == (slice(0, 7), slice(0, 6))
    assert robot().place("spin")[1:] == (slice(1, 3), slice(1, 2))
    assert robot().place("lift")[1:] == (slice(3, 4), slice(2, 3))
    with pytest.raises(InputError, match="did you mean left_knee_flexion or right_knee_flexion"):
        body_of("human34").place("knee")
    with pytest.raises(InputError, match="'inner' follows another joint"):
        body_of("gripper").place("inner")


def test_values_are_those_of_the_run(run: Run) -> None:
    bend, spin, lift = run["bend"], run["spin"], run["lift"]
    assert (bend.unit, spin.unit, lift.unit) == ("rad", "rad", "m")
    np.testing.assert_array_equal(bend.value, run.q[:, 0])
    np.testing.assert_array_equal(bend.std, run.std[:, 0])
    np.testing.assert_array_equal(bend.hypotheses, run.mode_q[:, :, 0])
    np.testing.assert_array_equal(bend.weights, run.mode_weight)
    np.testing.assert_array_equal(bend.time, run.time)
    np.testing.assert_array_equal(lift.value, run.q[:, 3])
    np.testing.assert_array_equal(lift.std, run.std[:, 2])
    assert (bend.lower, bend.upper) == (-2.0, 2.0)
    known = np.arange(8) != 5
    np.testing.assert_allclose(spin.value[known], (2.8 + 0.2 * np.arange(8))[known])  # continued beyond half a turn
    np.testing.assert_allclose(spin.hypotheses[known, 1] - spin.value[known], 0.2)
    assert np.isnan([bend.value[5], bend.std[5], spin.value[5], lift.high[5]]).all()


def test_degrees_and_back(run: Run) -> None:
    bend = run["bend"]
    for name in ("value", "std", "low", "high", "hypotheses", "lower", "upper"):
        np.testing.assert_allclose(np.deg2rad(getattr(bend.degrees, name)), getattr(bend, name), rtol=1e-14)
    assert bend.degrees.unit == bend.degrees.degrees.unit == "deg"
    np.testing.assert_array_equal(bend.degrees.degrees.value, bend.degrees.value)
    np.testing.assert_array_equal(run["lift"].degrees.value, run["lift"].value)
    np.testing.assert_allclose(run.angle("bend", degrees=True), np.degrees(run.q[:, 0]))
    np.testing.assert_array_equal(run.angle("spin"), run["spin"].value)
    with pytest.raises(InputError, match="'lift' slides: it has metres"):
        run.angle("lift", degrees=True)


def test_the_interval_is_that_of_the_mixture(run: Run) -> None:
    """Its ends against roots of the mixture's distribution, computed independently; a Gaussian of equal moments is far
    off."""
    c = PosteriorCalibration()
    z, share = np.polynomial.hermite_e.hermegauss(7)
    scale = SPREAD * np.sqrt(c.covariance_scale) * np.exp(c.scale_spread * z)

    def below(x: float, middles: tuple[float, float]) -> float:
        return float(sum(0.5 * share / np.sqrt(2.0 * np.pi) @ norm.cdf((x - m) / scale) for m in middles))

    for name, apart in (("bend", APART), ("spin", 0.2)):
        joint = run[name]
        middles = (float(joint.hypotheses[3, 0]), float(joint.hypotheses[3, 0]) + apart)
        for end, level in ((joint.low[3], 0.05), (joint.high[3], 0.95)):
            expected = brentq(lambda x, p=level, m=middles: below(x, m) - p, middles[0] - 1.0, middles[1] + 1.0)
            assert end == pytest.approx(expected, abs=1e-9)
    bend = run["bend"]
    assert bend.high[3] - np.mean(bend.hypotheses[3]) < 0.85 * 1.645 * bend.std[3]


def test_frames_are_as_sure_together_as_alone(tmp_path: Path) -> None:
    """Over more frames than one block, one of them without a pose, at limits and away from them."""
    body, rng = body_of("arm8"), np.random.default_rng(2)
    q = np.array([[body.integrate(body.neutral, rng.normal(size=body.nv)) for _ in range(2)] for _ in range(40)])
    q[5] = np.nan
    run = made_run(tmp_path / "arm.run", body.subject, q, weight=(0.6, 0.4))
    interval = run.interval(0.8)
    spread = run.spread
    for t in {*range(40)} - {5}:
        alone = run.posterior(t).marginals()
        ends = alone.quantiles(0.1, 0.9)
        np.testing.assert_allclose(spread.std[t], alone.moments()[1], rtol=1e-9)
        np.testing.assert_allclose(spread.ends[t], alone.quantiles(0.05, 0.95), atol=1e-9)
        np.testing.assert_allclose(interval[t], run.posterior(t).best + ends, atol=1e-9)  # joints with one coordinate
    assert np.isnan(interval[5]).all()
    with pytest.raises(InputError, match="level: 90 is not a probability"):
        run.interval(90)


def test_a_joints_name_in_another_place_is_explained_with_an_example(run: Run) -> None:
    wrong: Any
    for wrong, example in (("bend", "bend"), ("spin", "spin"), (None, "bend"), ([0.9], "bend"), (True, "bend")):
        message = rf"level: cannot be .*run.interval.0.9.; of one joint: run.'{example}'..low and .high"
        with pytest.raises(InputError, match=message):
            run.interval(wrong)
    for wrong, ask in (("spin", run.result), ("spin", run.posterior), (1.5, run.posterior), ("bend", run.observation)):
        with pytest.raises(InputError, match=r"frame: cannot be .*run.result.0.; a joint over time is run"):
            ask(wrong)
    np.testing.assert_array_equal(run.interval(np.float64(0.8)), run.interval(0.8))
    assert run.result(np.int64(0)).index == run.result(0).index  # type: ignore[arg-type]


def test_what_has_no_angle_is_refused_with_what_it_may_be(run: Run, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no joint 'ben' .did you mean bend"):
        run["ben"]
    with pytest.raises(InputError, match=r"joint: cannot be of type int .3.*run.result"):
        run[3]  # type: ignore[index]
    body = body_of("human34")
    person = made_run(tmp_path / "p.run", body.subject, np.tile(body.neutral, (2, 1, 1)))
    for name in ("root", "root_qw", "root_x"):
        with pytest.raises(InputError, match=r"several degrees of freedom.*entries 0 to 6 of q are root_x"):
            person.angle(name)
    with pytest.raises(InputError, match="did you mean left_knee_flexion"):
        person["left_knee"]
    assert person.joint_names == body.q_names[7:]


def test_a_joint_that_follows_has_its_masters_spread(tmp_path: Path) -> None:
    body = body_of("gripper")
    q = body.neutral.copy()
    q[body.place("drive").q] = 0.4
    run = made_run(tmp_path / "g.run", body.subject, np.tile(q, (2, 1, 1)))
    drive, inner = run["drive"], run["inner"]
    np.testing.assert_allclose(inner.value, MULTIPLIER * drive.value + OFFSET)
    np.testing.assert_allclose(inner.std, abs(MULTIPLIER) * drive.std)
    np.testing.assert_allclose(inner.low, MULTIPLIER * drive.high + OFFSET)  # a negative multiplier swaps the ends


def test_a_table_has_the_runs_arrays(run: Run) -> None:
    pytest.importorskip("pandas", reason="the extra pandas is not installed")
    frame = run.to_dataframe()
    assert list(frame.columns[:4]) == ["time_s", "status", "bend_rad", "bend_std_rad"]
    assert frame["status"].tolist() == run.status.tolist()
    np.testing.assert_array_equal(frame["time_s"], run.time)
    for name in run.joint_names:
        joint = run[name]
        np.testing.assert_array_equal(frame[f"{name}_{joint.unit}"], joint.value)
        np.testing.assert_array_equal(frame[f"{name}_std_{joint.unit}"], joint.std)
    degrees = run.to_dataframe(degrees=True)
    np.testing.assert_array_equal(degrees["bend_deg"], run["bend"].degrees.value)
    np.testing.assert_array_equal(degrees["lift_m"], run["lift"].value)
    assert not [name for name in degrees.columns if name.endswith("_rad")]


def test_a_missing_pandas_names_the_remedy(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match=r"pip install 'kinemode\[pandas\]'"):
        run.to_dataframe()


def test_csv_keeps_its_columns_and_has_degrees_on_request(run: Run, tmp_path: Path) -> None:
    with km.export(run, tmp_path / "a.csv").open() as file:
        rows = list(csv.reader(file))
    last = rows[0].index("status")
    assert rows[0][:5] == ["time_s", "bend_rad", "spin_cos", "spin_sin", "lift_m"]
    assert rows[0][last + 1 :] == ["bend_std_rad", "spin_std_rad", "lift_std_m"]
    np.testing.assert_allclose([float(row[-1]) for row in rows[1:6]], run.std[:5, 2], rtol=1e-8)
    with km.export(run, tmp_path / "b.csv", degrees=True).open() as file:
        columns = {name: list(column) for name, *column in zip(*csv.reader(file), strict=True)}
    assert list(columns)[:5] == ["time_s", "bend_deg", "bend_std_deg", "spin_deg", "spin_std_deg"]
    assert columns["bend_deg"][5] == ""
    for name in run.joint_names:
        joint = run[name].degrees
        for suffix, values in (("", joint.value), ("_std", joint.std)):
            read = [float(cell or "nan") for cell in columns[f"{name}{suffix}_{joint.unit}"]]
            np.testing.assert_allclose(read, values, rtol=1e-8)
    with pytest.raises(InputError, match="mot has its own units"):
        km.export(run, tmp_path / "a.mot", degrees=True)


def test_objects_describe_themselves(run: Run) -> None:
    unread = Run.open(run.file)
    assert repr(unread) == "<Run robot.run: frames 8 of 8 (0.23 s), subject test, cameras a, tracker css>"
    assert "_frames" not in vars(unread)  # no frame was read
    assert repr(run["bend"]).startswith(
        "<JointAngle bend: frames 8, time 0.00 to 0.23 s, value 0 to 0.7 rad, median std"
    )
    assert "degrees of freedom 3" in repr(run.body)
    assert "root fixed" in repr(run.subject)
    assert "640x480" in repr(run.header.cameras[0])
    for thing in (unread, run["bend"], run.body, run.subject, run.header.cameras[0]):
        page = thing._repr_html_()
        assert page.count("<tr>") == page.count("</tr>") >= 3
        assert len(repr(thing)) < 200
