"""Forces of runs: units and files, bands, what is refused, and force plates."""

from __future__ import annotations

import csv
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from builders import bent, body_of
from made_runs import made_run

import kinemode as km
from benchmarks.accuracy.forces import Trial, figures_of, plates_of
from estimator.data.formats.opensim import R_OPENSIM_WORLD
from estimator.dynamics.contact_forces import GRAVITY
from estimator.dynamics.trunk import Trunk
from estimator.runs.forces import Forces
from estimator.runs.inverse_dynamics import _resting, _seat, mass_of
from estimator.runs.run_motion import trunk_stretch, usual_cutoff
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import Body
from humanoid.subject.marker_set import marker_set
from humanoid.support.errors import InputError
from kinemode.__main__ import main

BODY = body_of("human34")
TIME = np.arange(72) / 60.0


def squatting(depth: float) -> np.ndarray:
    """Poses (T, nq) of two squats, the feet flat in one place."""
    q = []
    for knee in depth * (1.0 - np.cos(2.0 * np.pi * TIME / 0.6)):
        bends = {"hip_flexion": 0.5 * knee, "knee_flexion": knee, "ankle_dorsiflexion": 0.5 * knee}
        bends |= {"hip_abduction": 0.0, "hip_rotation": 0.0}
        pose = bent(BODY, **{f"{side}_{joint}": a for side in ("left", "right") for joint, a in bends.items()})
        pose[:3] -= BODY.landmarks(BODY.at(pose))[BODY.landmark_names.index("left_heel")]
        q.append(pose)
    return np.array(q)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return made_run(
        tmp_path_factory.mktemp("squat") / "squat.run", BODY.subject, squatting(0.3)[:, None], std=1e-3, times=TIME
    )


@pytest.fixture(scope="module")
def forces(run: Run) -> Forces:
    with pytest.warns(km.InputWarning, match="not smoothed"):
        return km.forces(run, mass=60.0, filter=0.0)


def test_feet_carry_the_weight_over_whole_squats(forces: Forces) -> None:
    """Whoever ends as at the start gets as much impulse as the weight, and each foot the same in a symmetric pose."""
    inner = slice(0, 36 * 2)
    assert forces.weight == pytest.approx(60.0 * GRAVITY)
    assert forces.total[inner, 2].mean() == pytest.approx(forces.weight, rel=0.02)
    assert np.ptp(forces.total[5:-5, 2]) > 0.2 * forces.weight
    np.testing.assert_allclose(forces.force[5:-5, 0, 2], forces.force[5:-5, 1, 2], atol=0.01 * forces.weight)
    knee = [forces.names.index(f"{side}_knee_flexion") for side in ("left", "right")]
    assert (forces.moment[18, knee] < -5.0).all()  # they hold against flexion


def test_bands_lie_within_each_other_and_grow_with_the_mass_that_is_not_known(run: Run, forces: Forces) -> None:
    narrow, wide = forces.interval("force", 0.5), forces.interval("force", 0.9)
    assert (wide[0] <= narrow[0]).all()
    assert (narrow[1] <= wide[1]).all()
    assert (forces.force[..., 2] > wide[0, ..., 2]).all()
    with pytest.warns(km.InputWarning, match="not smoothed"):
        guessed = km.forces(run, filter=0.0)
    assert guessed.mass.std > 5.0
    assert guessed.std("force")[20, 0, 2] > forces.std("force")[20, 0, 2] + 10.0
    with pytest.raises(InputError, match="one of force, pressure"):
        forces.interval("weight")
    with pytest.raises(InputError, match="between 0 and 1"):
        forces.interval("force", 90.0)


def test_a_camera_whose_upright_is_assumed_is_noted(forces: Forces) -> None:
    assert "gravity is taken along the camera's own upright" in forces.remark


def test_the_csv_has_units_and_bands(forces: Forces, tmp_path: Path) -> None:
    with forces.write(tmp_path / "forces.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(TIME)
    row, half = rows[20], 0.5 * np.ptp(forces.interval("force"), axis=0)
    assert float(row["left force z [N]"]) == pytest.approx(forces.force[20, 0, 2], rel=1e-5)
    assert float(row["left force z +- 90 % [N]"]) == pytest.approx(half[20, 0, 2], rel=1e-5)
    assert float(row["left force z [% of weight]"]) == pytest.approx(50.0, abs=30.0)
    assert "left_knee_flexion moment [N m]" in row
    assert "left_knee_flexion power [W]" in row


def test_forces_along_the_way_a_body_faces_turn_with_it(forces: Forces, tmp_path: Path) -> None:
    """Whoever is turned about the vertical has the same forces forwards and to the left."""
    quarter, turned = np.sqrt(0.5) * np.array([0.0, 0.0, 1.0, 1.0]), squatting(0.3)
    turned[:, :2] = np.stack([-turned[:, 1], turned[:, 0]], axis=1)
    turned[:, 3:7] = quarter
    run = made_run(tmp_path / "turned.run", BODY.subject, turned[:, None], std=1e-3, times=TIME)
    with pytest.warns(km.InputWarning, match="not smoothed"):
        aside = km.forces(run, mass=60.0, filter=0.0)
    np.testing.assert_allclose(forces.facing, np.tile([1.0, 0.0], (len(TIME), 1)), atol=1e-9)
    np.testing.assert_allclose(aside.facing, np.tile([0.0, 1.0], (len(TIME), 1)), atol=1e-9)
    np.testing.assert_allclose(aside.force_in_facing, forces.force_in_facing, atol=0.1)
    np.testing.assert_allclose(forces.force_in_facing, forces.force, atol=1e-6)


def test_opensim_reads_loads_and_moments(forces: Forces, tmp_path: Path) -> None:
    """External loads in OpenSim's axes, which turn back to ours, and moments by the names of the joints."""

    def table(path: Path) -> dict[str, np.ndarray]:
        head, _, rest = path.read_text().partition("endheader\n")
        lines = rest.splitlines()
        values = np.array([[float(cell) for cell in line.split("\t")] for line in lines[1:]])
        assert f"nRows={len(values)}" in head
        return dict(zip(lines[0].split("\t"), values.T, strict=True))

    loads = table(forces.write(tmp_path / "loads.mot"))
    for kind, values in (("v", forces.force[:, 1]), ("p", forces.pressure[:, 1])):
        read = np.stack([loads[f"ground_force_r_{kind}{axis}"] for axis in "xyz"], axis=1)
        np.testing.assert_allclose(read @ R_OPENSIM_WORLD, values, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(loads["ground_torque_r_y"], forces.free_moment[:, 1], atol=1e-6)
    moments = table(forces.write(tmp_path / "moments.sto"))
    j = forces.names.index("left_hip_flexion")
    np.testing.assert_allclose(moments["left_hip_flexion_moment"], forces.moment[:, j], rtol=1e-6)


def test_forces_end_at_frames_without_a_pose(tmp_path: Path) -> None:
    q = squatting(0.1)
    q[30] = np.nan
    gap = made_run(tmp_path / "gap.run", BODY.subject, q[:, None], times=TIME)
    with pytest.warns(km.InputWarning, match="0.00 to 0.48 s, 0.52 to 1.18 s alone"):
        forces = km.forces(gap, mass=60.0, filter=0.0)
    assert np.isnan(forces.force[30]).all()
    assert np.isfinite(np.delete(forces.force, 30, axis=0)).all()
    with pytest.raises(InputError, match="eight poses in a row"):
        km.forces(made_run(tmp_path / "short.run", BODY.subject, q[:5, None]), mass=60.0)


def test_what_nothing_carries_is_noted_and_within_the_bands(tmp_path: Path) -> None:
    """Somebody who stands, and is then pulled forwards by more than friction bears."""
    q = np.tile(squatting(0.0)[0], (len(TIME), 1))
    q[:, 0] += 0.5 * 1.5 * GRAVITY * np.square(np.maximum(TIME - 0.9, 0.0))
    with pytest.warns(km.InputWarning, match="nothing known can carry"):
        forces = km.forces(made_run(tmp_path / "up.run", BODY.subject, q[:, None], times=TIME), mass=60.0, filter=0.0)
    assert forces.total[20, 2] == pytest.approx(forces.weight, rel=0.05)
    assert forces.total[62, 0] < 0.85 * forces.weight
    assert forces.interval("total")[1, 62, 0] > 1.45 * forces.weight


def test_the_trunk_is_as_long_as_its_markers_have_it(tmp_path: Path) -> None:
    """Whatever the markers' places on it, and where one is missing."""
    subject = BODY.subject.with_markers(marker_set("plug-in-gait").markers)
    body, longer = Body(subject), 0.02 * np.sin(4.0 * TIME)
    q = np.tile(squatting(0.0)[0], (len(TIME), 1))
    markers = body.markers_of(body.placed(q))
    trunk = Trunk.of(body)
    assert trunk is not None
    own = np.flatnonzero(body.marker_joint == trunk.joint)
    axis = body.at(q[0]).rotations[trunk.joint] @ trunk.axis
    markers[:, own] += longer[:, None, None] * axis + np.array([0.01, 0.0, 0.03])
    markers[20:30, own[0]] = np.nan
    run = cast(Run, SimpleNamespace(body=body, q=q, time=TIME, index=np.arange(len(TIME)), markers=markers))
    stretch = trunk_stretch(run)
    assert stretch is not None
    np.testing.assert_allclose(stretch - stretch.mean(), longer - longer.mean(), atol=2e-3)


def test_who_never_stands_is_refused(tmp_path: Path) -> None:
    q = np.tile(BODY.neutral, (len(TIME), 1))
    q[:, 0] = 3.0 * TIME
    flying = made_run(tmp_path / "flying.run", BODY.subject, q[:, None], times=TIME)
    with pytest.raises(InputError, match=r"never stand|treadmill"):
        km.forces(flying, mass=60.0)


def test_bodies_without_masses_are_refused_and_those_with_a_fixed_base_have_moments_alone(tmp_path: Path) -> None:
    gripper = body_of("gripper")
    still = np.tile(gripper.neutral, (20, 1))[:, None]
    with pytest.raises(InputError, match="no masses"):
        km.forces(made_run(tmp_path / "gripper.run", gripper.subject, still))
    arm = body_of("arm8")
    moments = km.forces(made_run(tmp_path / "arm.run", arm.subject, np.tile(arm.neutral, (20, 1))[:, None]), mass=60)
    assert moments.feet == ()
    assert moments.moment.shape == (20, arm.nv)
    assert moments.write(tmp_path / "moments.csv").read_text().count("moment [N m]") == arm.nv
    with pytest.raises(InputError, match="no external loads"):
        moments.write(tmp_path / "loads.mot")


@pytest.mark.parametrize("mass", [0.5, -70.0, float("nan"), 1e4])
def test_a_mass_that_is_none_is_refused(mass: float) -> None:
    with pytest.raises(InputError, match="mass"):
        mass_of(BODY, mass)


def test_the_command_prints_writes_and_refuses_early(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, plot = tmp_path / "forces.csv", tmp_path / "forces.png"
    assert main(["forces", str(run.file), "--mass", "60", "--out", str(out), "--plot", str(plot)]) == 0
    printed = capsys.readouterr().out
    assert "mass 60.0" in printed
    assert "right" in printed
    assert out.stat().st_size > 0
    assert plot.stat().st_size > 0
    assert main(["forces", str(run.file), "--out", "forces.txt"]) != 0
    assert "let it end in .csv, .mot, .sto" in capsys.readouterr().err


def test_hips_rest_on_a_seat_and_not_at_the_bottom_of_a_landing() -> None:
    time = np.arange(240) / 60.0
    sits = np.maximum(np.abs(time - 2.0) - 0.8, 0.0)  # down, still for more than a second and a half, up
    lands = np.abs(time - 2.0)
    heights = [np.column_stack([0.0 * time, 0.0 * time, height]) for height in (sits, lands**2, lands)]
    seat, squat, landing = (_resting(time, hips) for hips in heights)
    assert seat[120] > 0.95
    assert seat[:30].max() < 0.1
    assert squat[120] < 0.75
    assert landing.max() < 0.05


def test_a_deep_squat_is_not_a_seat(tmp_path: Path) -> None:
    deep = made_run(tmp_path / "deep.run", BODY.subject, squatting(0.95)[:, None], times=TIME)
    place, seated = _seat(deep)
    assert place is not None
    hips = deep.landmarks[:, BODY.landmark_names.index("mid_hip"), 2]
    assert hips.min() < 0.7 * hips.max()
    assert seated.max() < 0.1


def test_few_frames_a_second_are_not_filtered() -> None:
    assert usual_cutoff(np.arange(10) / 24.0) == 0.0
    assert usual_cutoff(np.arange(10) / 60.0) == 12.0


def test_force_plates_agree(shared_data: Path) -> None:
    """Of a walk by its markers, in percent of the weight."""
    file = shared_data / "opencap" / "subject4" / "walking1.trc"
    if not file.is_file():
        pytest.skip("needs opencap/subject4")
    walk = km.track("human34", points=file)
    plates = plates_of(file.with_name("walking1_grf.mot"), walk)
    trial = Trial("subject4", "walking1", walk, km.forces(walk, mass=60.0), plates, 63.8 * GRAVITY)
    figures = figures_of(trial)
    assert figures["frames"] > 100
    assert all(error < most for error, most in zip(figures["total"], (4.0, 3.0, 2.0), strict=True))
    assert all(error < most for error, most in zip(figures["foot"], (6.0, 4.0, 2.0), strict=True))
    assert figures["pressure_mm"] < 30.0
    assert min(figures["total_in_90"]) > 0.7
    assert figures["moments"]["knee_flexion"][0] < 0.25


def test_pages_have_the_forces_where_the_mass_is_given(run: Run, tmp_path: Path) -> None:
    """The report their curves; the preview an arrow on each foot, and a body that shows it."""
    report = km.report(run, tmp_path / "report.html", mass=60.0).read_text()
    assert "<h3>Forces</h3>" in report
    assert "Mass 60.0 kg" in report
    preview = km.view(run, html=tmp_path / "view.html", mass=60.0)
    assert preview is not None
    assert '"body_opacity": 0.5' in preview.read_text()
    assert "<h3>Forces</h3>" not in km.report(run, tmp_path / "plain.html").read_text()
