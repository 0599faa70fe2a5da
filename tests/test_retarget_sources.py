"""Motions to follow: the same landmarks from every source, gaps filled or reported, faults in a line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.robustness.c3d_files import c3d_file
from estimator.data.formats.opensim import R_OPENSIM_WORLD, write_trc
from estimator.inference.contacts import stances_of
from estimator.retargeting.contacts import source_contacts
from estimator.retargeting.joint_orders import ORDERS, SMPL
from estimator.retargeting.source import SourceMotion, filled
from estimator.runs.export import export
from estimator.runs.run_reader import Run
from estimator.synthesis.mocap import load_mocap
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode.inputs.motions import SourceOptions, load_source
from tests.builders import body_of
from tests.made_runs import made_run
from tests.test_bvh import puppet

FRAMES, RATE = 12, 30.0
LIMBS = tuple(
    f"{side}_{part}" for part in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist") for side in ("left", "right")
)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """human34 walking, bending its joints and leaning."""
    subject = load_subject("human34")
    body = Body(subject)
    rng = np.random.default_rng(3)
    speed = 0.4 * rng.normal(size=body.nv)
    speed[:6] = 0.5, 0.1, 0.0, 0.0, 0.0, 0.3
    q = np.array([body.integrate(body.neutral, np.sin(t / 12.0) * speed) for t in range(FRAMES)])
    q[:, 2] += 1.0
    return made_run(tmp_path_factory.mktemp("source") / "walk.run", subject, q[:, None])


def smpl(source: SourceMotion) -> np.ndarray:
    """(T, 24, 3) [m] in SMPL's order of a motion's landmarks, the head at the top, everything else at the hips."""
    hips = 0.5 * (source.landmark("left_hip") + source.landmark("right_hip"))
    renamed = {"head": "head_top"}
    kept = [renamed.get(name or "", name or "") for name in (*ORDERS[SMPL], None, None)]
    return np.stack([source.landmark(name) if name in source.names else hips for name in kept], axis=1)


def same(read: SourceMotion, run: Run, names: tuple[str, ...], within: float = 1e-6) -> None:
    truth = run.landmarks[:, [run.body.landmark_names.index(name) for name in names]]
    points = np.stack([read.landmark(name) for name in names], axis=1)
    assert points == pytest.approx(truth, abs=within)
    assert np.diff(read.times) == pytest.approx(np.diff(run.time), abs=1e-5)


def test_a_run_and_its_file(run: Run) -> None:
    for source in (run, run.file, str(run.file)):
        read = load_source(source)
        same(read, run, run.body.landmark_names, 0.0)
        assert read.source == "walk.run"
        assert read.notes == ()


def test_points_of_every_kind(run: Run, tmp_path: Path) -> None:
    names, points = run.body.landmark_names, run.landmarks
    write_trc(tmp_path / "a.trc", names, points, run.time)
    (tmp_path / "a.c3d").write_bytes(c3d_file(names, 1e3 * points, up="+Z", rate=RATE, first=1, whole=False))
    np.savez(tmp_path / "a.npz", points=points, names=np.array(names), fps=RATE, unit="m", up="z")
    export(run, tmp_path / "b.npz")
    head = ",".join(["time", *(f"{name}_{axis}_mm" for name in names for axis in "xyz")])
    rows = np.column_stack([run.time, 1e3 * points.reshape(FRAMES, -1)])
    text = "\n".join(",".join(f"{v:.6f}" for v in row) for row in rows)
    (tmp_path / "a.csv").write_text(f"{head}\n{text}\n")
    for name in ("a.trc", "a.c3d", "a.npz", "b.npz", "a.csv"):
        read = load_source(tmp_path / name, SourceOptions(up="z" if name == "a.csv" else None))
        same(read, run, names, 1e-5)


def thighs(motion: SourceMotion) -> np.ndarray:
    return np.asarray(np.linalg.norm(motion.landmark("left_hip") - motion.landmark("left_knee"), axis=1))


def test_bvh_has_the_joints(tmp_path: Path) -> None:
    path = tmp_path / "a.bvh"
    path.write_text(puppet(np.eye(3), 0.3, 10.0))
    mocap, read = load_mocap(path), load_source(path)
    assert {"left_big_toe", "right_big_toe", "head", "head_top", *LIMBS} == set(read.names)
    assert read.landmark("left_big_toe") == pytest.approx(mocap.points[:, mocap.names.index("left_toe")])
    assert thighs(read) == pytest.approx(0.415)
    assert "unit" in read.notes[0]
    declared = load_source(path, SourceOptions(unit="CM", fps=7.0))
    assert thighs(declared) == pytest.approx(0.5)
    assert len(declared.notes) == 1
    assert "--fps 7 is taken" in declared.notes[0]


@pytest.mark.parametrize("up", ["z", "y"])
@pytest.mark.parametrize("rate", ["fps", "mocap_framerate", "mocap_frame_rate"])
def test_smpl_joints(run: Run, tmp_path: Path, up: str, rate: str) -> None:
    joints = smpl(load_source(run))
    own = joints @ R_OPENSIM_WORLD.T if up == "y" else joints
    np.savez(tmp_path / "a.npz", joints3d=own.astype(np.float32), **{rate: np.float32(RATE)})
    read = load_source(tmp_path / "a.npz")
    same(read, run, (*LIMBS, "left_big_toe", "right_big_toe", "neck"), 1e-5)
    assert f"{up} is taken to point up" in read.notes[0]
    declared = load_source(tmp_path / "a.npz", SourceOptions(up=up, fps=60.0))
    assert declared.notes == ()
    assert declared.times[-1] == pytest.approx((FRAMES - 1) / 60.0)
    np.savez(tmp_path / "b.npz", joints3d=1e3 * own, fps=RATE)
    same(load_source(tmp_path / "b.npz", SourceOptions(up=up, unit="Millimetres")), run, LIMBS, 1e-5)
    with pytest.raises(InputError, match="not a unit of length"):
        load_source(tmp_path / "b.npz", SourceOptions(unit="inch"))


@pytest.mark.parametrize("frames", [1, 2])
def test_short_clips(run: Run, tmp_path: Path, frames: int) -> None:
    joints = smpl(load_source(run))[:frames]
    np.savez(tmp_path / "a.npz", person=joints, fps=RATE)
    read = load_source(tmp_path / "a.npz")
    assert read.points.shape == (frames, 16, 3)
    assert filled(read, 0.5).points == pytest.approx(read.points)
    contacts = source_contacts(read)
    assert contacts.standing.shape == (frames, 4)
    np.savez(
        tmp_path / "b.npz", points=joints[:, [1, 4]], names=np.array(["left_hip", "left_knee"]), time=range(frames)
    )
    assert len(load_source(tmp_path / "b.npz", SourceOptions(up="z", unit="m")).times) == frames


@pytest.mark.parametrize(("first", "after"), [(3, 7), (5, 11)])
def test_joints_that_were_not_measured_are_missing(run: Run, tmp_path: Path, first: int, after: int) -> None:
    joints = smpl(load_source(run))
    joints[first:after] = joints[first]
    np.savez(tmp_path / "a.npz", joints=joints, fps=RATE)
    read = load_source(tmp_path / "a.npz", SourceOptions(up="z"))
    missing = np.isnan(read.points).all(axis=(1, 2))
    assert np.flatnonzero(missing).tolist() == list(range(first + 1, after))
    assert f"a.npz: {after - first - 1} frames repeat" in read.notes[0]


def test_a_frame_alone_needs_no_rate(run: Run, tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", joints=smpl(load_source(run))[:1])
    assert load_source(tmp_path / "a.npz").times.tolist() == [0.0]


def faulty(folder: Path, name: str) -> Path:
    """A file with a fault."""
    body, path = body_of("human34"), folder / f"{name}.npz"
    standing = body.landmarks(body.at(body.neutral))
    joints = smpl(SourceMotion(body.landmark_names, np.tile(standing, (4, 1, 1)), np.arange(4) / RATE, "standing"))
    joints[..., 0] += 0.1  # nothing is at zero
    if name == "cut":
        np.savez(path, joints=joints, fps=RATE)
        path.write_bytes(path.read_bytes()[:-300])
    elif name == "nan":
        np.savez(path, joints=np.full_like(joints, np.nan), fps=RATE)
    elif name == "rate":
        np.savez(path, joints=joints)
    elif name == "zero_rate":
        np.savez(path, joints=joints, fps=0.0)
    elif name == "few":
        np.savez(path, joints=joints[:, :16], fps=RATE)
    elif name == "flat":
        np.savez(path, joints=joints.reshape(4, -1), fps=RATE)
    elif name == "empty":
        np.savez(path, joints=joints[:0], fps=RATE)
    elif name == "huge":
        np.savez(path, joints=1e3 * joints, fps=RATE)
    elif name == "lying":
        joints[:2, :, 2] *= -1.0  # upside down half of the time
        np.savez(path, joints=joints, fps=RATE)
    elif name == "markers":
        np.savez(path, points=joints[:, :3], names=np.array(["LASI", "RASI", "LKNE"]), fps=RATE, up="z", unit="m")
    elif name == "other":
        np.savez(path, poses=joints)
    return path


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("cut", "cannot be read"),
        ("nan", "all are NaN or zero"),
        ("rate", "does not give its frames per second (--fps gives them"),
        ("zero_rate", "fps: must be"),
        ("few", "joints: is of shape (4, 16, 3)"),
        ("flat", "joints: is of shape (4, 72)"),
        ("empty", "has no frame"),
        ("huge", "spread over"),
        ("lying", "give it with --up"),
        ("markers", "markers are tracked first: kinemode track --points markers.npz"),
        ("other", "has no joints and no points (one of joints, person"),
        ("missing", "no such file"),
    ],
)
def test_faults_of_arrays(tmp_path: Path, name: str, message: str) -> None:
    with pytest.raises(InputError) as raised:
        load_source(faulty(tmp_path, name))
    assert message in str(raised.value)
    assert f"{name}.npz" in str(raised.value)
    assert "\n" not in str(raised.value)


def test_faults_of_other_files(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.fbx").write_text("x")
    (tmp_path / "a.run").write_text("x")
    for name, message in (
        ("a.fbx", r"give a run \(.run\), BVH"),
        ("a.run", "not a run file"),
        ("b.trc", "no such file"),
    ):
        with pytest.raises(InputError, match=message):
            load_source(tmp_path / name)
    with pytest.raises(InputError, match=r"source: cannot be of type int \(3\) \(give a run"):
        load_source(3)  # type: ignore[arg-type]
    assert load_source(wave({})).names == wave({}).names
    with pytest.raises(InputError, match="fps: of a run is known"):
        load_source(run, SourceOptions(fps=30.0))
    (tmp_path / "a.bvh").write_text("x")
    with pytest.raises(InputError, match="not a unit of length"):
        load_source(tmp_path / "a.bvh", SourceOptions(unit="inch"))


def wave(gaps: dict[str, slice]) -> SourceMotion:
    times = np.arange(60) / 30.0
    way = np.stack([times, np.sin(times), np.ones(60)], axis=1)
    points = np.stack([way, way + 1.0], axis=1)
    for column, name in enumerate(("left_wrist", "right_wrist")):
        if name in gaps:
            points[gaps[name], column] = np.nan
    return SourceMotion(("left_wrist", "right_wrist"), points, times, "a.npz")


def test_short_gaps_are_filled() -> None:
    whole = wave({}).points
    out = filled(wave({"left_wrist": slice(20, 25)}), 0.3)
    assert out.points == pytest.approx(whole, abs=2e-3)
    assert out.notes == ("a.npz: gaps of at most 0.3 s are filled: left_wrist in 5 frames",)
    held = filled(wave({"left_wrist": slice(0, 4)}), 0.3).points
    assert held[:4, 0] == pytest.approx(np.repeat(whole[4:5, 0], 4, axis=0))
    assert filled(wave({"right_wrist": slice(57, 60)}), 0.3).points[-1, 1] == pytest.approx(whole[56, 1])


def test_long_gaps_are_reported() -> None:
    out = filled(wave({"left_wrist": slice(20, 50), "right_wrist": slice(0, 60)}), 0.5)
    assert np.isnan(out.points[20:50, 0]).all()
    assert np.isfinite(out.points[:20, 0]).all()
    assert out.notes == (
        "a.npz: missing for longer than 0.5 s, not filled: left_wrist from 0.67 to 1.63 s",
        "a.npz: never known: right_wrist",
    )
    lone = filled(wave({"left_wrist": slice(1, 60)}), 5.0)
    assert lone.points[:, 0] == pytest.approx(np.repeat(lone.points[:1, 0], 60, axis=0))


def stepping(flight: bool = False) -> SourceMotion:
    """Ankles and toes of two feet that step in turn, 0.5 s each; flight: both are in the air at the same time."""
    times = np.arange(90) / 30.0
    points = np.zeros((90, 4, 3))
    for foot, late in ((0, 0.0), (1, 0.0 if flight else 0.5)):
        phase = ((times + late) % 1.0) / 0.5
        cycle = np.floor(times + late)
        swing = np.clip(phase - 1.0, 0.0, 1.0)
        x = 0.6 * (cycle + 0.5 - 0.5 * np.cos(np.pi * swing))
        z = 0.15 * np.sin(np.pi * swing) ** 2
        for k, (ahead, high) in enumerate(((0.0, 0.08), (0.15, 0.02))):
            points[:, 2 * foot + k] = np.stack([x + ahead, np.full(90, 0.2 * foot), 0.3 + high + z], axis=1)
    return SourceMotion(("left_ankle", "left_big_toe", "right_ankle", "right_big_toe"), points, times, "a.npz")


def test_feet_stand_in_turn_on_a_level_floor() -> None:
    contacts = source_contacts(stepping())
    assert contacts.names == ("left_heel", "left_big_toe", "right_heel", "right_big_toe")
    assert contacts.landmarks == ("left_ankle", "left_big_toe", "right_ankle", "right_big_toe")
    assert contacts.floor == pytest.approx(0.3, abs=0.01)
    assert "floor at 0.30" in contacts.note
    swing = (stepping().times % 1.0) > 0.6
    lift = swing & ((stepping().times % 1.0) < 0.9)
    assert not contacts.standing[lift, :2].any()
    assert contacts.standing[~(stepping().times % 1.0 > 0.45), :2].mean() > 0.9
    assert contacts.standing[lift, 2:].mean() > 0.9


def test_both_feet_may_be_in_the_air() -> None:
    contacts = source_contacts(stepping(flight=True))
    at = stepping().times % 1.0
    assert not contacts.standing[(at > 0.62) & (at < 0.88)].any()


@pytest.mark.parametrize(("length", "parts"), [(0.04, 1), (0.1, 2)])
def test_a_small_step_parts_a_stance(length: float, parts: int) -> None:
    """Within 0.4 s, too slowly to be found by speed alone; a foot that rolls over stays."""
    times = np.arange(90) / 30.0
    points = np.zeros((90, 4, 3))
    points[:, 2:, 1] = 0.2
    points[:, [0, 2], 2], points[:, [1, 3], 2] = 0.08, 0.02
    points[:, :2, 0] += length * np.clip((times - 1.5) / 0.4, 0.0, 1.0)[:, None]
    contacts = source_contacts(SourceMotion(stepping().names, points, times, "a.npz"))
    stances = [stance for stance in stances_of(contacts.standing.astype(float)) if stance[0] < 2]
    assert len(stances) == 2 * parts
    assert contacts.standing[:, 2:].all()


def test_a_motion_without_feet_has_no_contacts() -> None:
    contacts = source_contacts(wave({}))
    assert contacts.standing.shape == (60, 0)
    assert contacts.floor is None
    assert "contacts and floor are off" in contacts.note
