"""Run files: what was written is read, whatever happens to the writer."""

from __future__ import annotations

import dataclasses
import os
import signal
import sqlite3
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from estimator.data.cameras.camera import guessed_camera
from estimator.data.formats.packing import pack, unpack
from estimator.data.observation import Observation, PoseEstimate
from estimator.runs.export import export_arrays
from estimator.runs.run_file import RunWriter
from estimator.runs.run_header import RunHeader
from estimator.runs.run_reader import Run
from estimator.trackers.frame_result import FrameResult, backtrack
from estimator.tracking.registry import settings_for
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from tests.waiting import DEADLINE


def header(frames: int, **changes: object) -> RunHeader:
    subject = load_subject("human34")
    made = RunHeader(
        subject_urdf=subject.urdf,
        subject_source="human34",
        subject_base=subject.base,
        cameras=(guessed_camera("a", (640, 480)),),
        clips={"a": None},
        image_sizes={"a": (640, 480)},
        times=np.arange(frames) / 30.0,
        tracker="css",
        settings={"modes": 7, "scale": 0.1},
        seed=3,
        version="0.1",
    )
    return dataclasses.replace(made, **changes)  # type: ignore[arg-type]


def walk(body: Body, frames: int, *, most: int = 3, seed: int = 0) -> list[FrameResult]:
    """A random walk with 1 to `most` hypotheses a frame."""
    rng = np.random.default_rng(seed)
    q, before = pin.neutral(body.model), 0
    results = []
    for i in range(frames):
        count = int(rng.integers(1, most + 1))
        modes = np.array([body.integrate(q, 0.05 * rng.standard_normal(body.nv)) for _ in range(count)])
        root = rng.standard_normal((count, body.nv, body.nv))
        weight = np.sort(rng.dirichlet(np.ones(count)))[::-1]
        parent = rng.integers(-1, before, count) if before else np.full(count, -1)
        results.append(
            FrameResult(
                i, i / 30.0, "tracked" if i % 7 else "hard", modes, weight, rng.random(count), root @ root.mT
                if hasattr(root, "mT") else root @ root.transpose(0, 2, 1), parent, rng.random(count) * 1e-7,
                np.zeros(count), ("as_detected",) * (count - 1) + ("exchanged",),
            )
        )  # fmt: skip
        q, before = modes[0], count
    return results


def state_of(result: FrameResult) -> dict[str, np.ndarray]:
    return {"q": result.q, "covariance": result.covariance, "rng": np.frombuffer(b"{}", np.uint8)}


@pytest.fixture(scope="module")
def body() -> Body:
    return Body(load_subject("human34"))


def assert_same(a: FrameResult, b: FrameResult) -> None:
    assert (a.index, a.time, a.status, a.association) == (b.index, b.time, b.status, b.association)
    for name in ("q", "weight", "energy", "parent", "kkt_residual", "penetration"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    np.testing.assert_allclose(a.covariance, b.covariance, rtol=1e-6, atol=1e-6)


def test_round_trip_leaves_one_file(tmp_path: Path, body: Body) -> None:
    results = walk(body, 20)
    file = tmp_path / "a.run"
    with RunWriter.create(file, header(20)) as writer:
        for i, result in enumerate(results):
            writer.append(result, state_of(result))
            if i == 9:  # readable while written
                half = Run.open(file)
                assert half.frame_count == 10
                assert not half.complete
                assert half.planned_count == 20
                assert_same(half.result(9), results[9])
        writer.finish()
    assert [p.name for p in tmp_path.iterdir()] == ["a.run"]
    run = Run.open(file)
    assert run.complete
    assert len(run) == 20
    assert run.subject.urdf == load_subject("human34").urdf
    for a, b in zip(run, results, strict=True):
        assert_same(a, b)
    k = run.mode_weight.shape[1]
    assert run.mode_q.shape == (20, k, body.nq)
    assert run.mode_parent.min() == -1
    for t, result in enumerate(results):
        n = len(result.weight)
        assert np.isnan(run.mode_q[t, n:]).all()
        assert (run.mode_parent[t, n:] == -1).all()
        chosen = run.path[t]
        np.testing.assert_array_equal(run.q[t], result.q[chosen])
        np.testing.assert_allclose(run.covariance[t], result.covariance[chosen], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(run.landmarks[t], body.landmarks(body.at(result.q[chosen])), atol=1e-12)
        assert run.energy[t] == result.energy[chosen]


def test_extra_arrays_are_stacked_and_filled_up(tmp_path: Path, body: Body) -> None:
    extras: list[dict[str, np.ndarray]] = [
        {"count": np.array(3), "sure": np.array(True), "beliefs": np.ones((2, 3), np.float32), "seen": np.array(["a"])},
        {"count": np.array(4), "beliefs": np.zeros((1, 4), np.float32), "seen": np.array(["bcd", "e"])},
        {"count": np.array(5), "beliefs": np.zeros((0, 0), np.float32), "alone": np.array([1.5])},
    ]
    results = [dataclasses.replace(r, extra=e) for r, e in zip(walk(body, 3), extras, strict=True)]
    with RunWriter.create(tmp_path / "a.run", header(3)) as writer:
        for result in results:
            writer.append(result, {})
    run = Run.open(tmp_path / "a.run")
    for i, extra in enumerate(extras):
        back = run.result(i).extra
        assert list(back) == list(extra)
        assert all(back[n].tobytes() == a.tobytes() and back[n].dtype == a.dtype for n, a in extra.items())
    assert list(run.extra) == ["count", "sure", "beliefs", "seen", "alone"]
    assert run.extra["count"].tolist() == [3, 4, 5]
    assert run.extra["count"].dtype.kind == "i"
    np.testing.assert_array_equal(run.extra["sure"], [1.0, np.nan, np.nan])
    np.testing.assert_array_equal(run.extra["alone"], [[np.nan], [np.nan], [1.5]])
    assert run.extra["seen"].tolist() == [["a", ""], ["bcd", "e"], ["", ""]]
    beliefs = np.full((3, 2, 4), np.nan)
    beliefs[0, :, :3], beliefs[1, :1] = 1.0, 0.0
    np.testing.assert_array_equal(run.extra["beliefs"], beliefs)
    assert export_arrays(run).keys() >= {f"extra_{name}" for name in run.extra}


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ([np.zeros(2), np.zeros((2, 2))], "extra array x: is of different kinds"),
        ([np.zeros(2), np.array(["a", "b"])], "extra array x: is of different kinds"),
        ([np.zeros((0, 999_999)), np.zeros((999_999, 0))], "would fill .2, 999999, 999999. entries"),
    ],
)
def test_extra_arrays_of_different_shapes(extra: list[np.ndarray], message: str, tmp_path: Path, body: Body) -> None:
    with RunWriter.create(tmp_path / "a.run", header(2)) as writer:
        for result, x in zip(walk(body, 2), extra, strict=True):
            writer.append(dataclasses.replace(result, extra={"x": x}), {})
    run = Run.open(tmp_path / "a.run")
    with pytest.raises(InputError, match=message):
        _ = run.extra
    assert [r.extra["x"].shape for r in run] == [x.shape for x in extra]


def test_no_frames(tmp_path: Path, body: Body) -> None:
    RunWriter.create(tmp_path / "a.run", header(5)).close()
    run = Run.open(tmp_path / "a.run")
    assert run.q.shape == (0, body.nq)
    assert run.landmarks.shape == (0, len(body.landmark_names), 3)
    assert run.covariance.shape == (0, body.nv, body.nv)
    assert run.path.shape == (0,)
    assert RunWriter.resume(tmp_path / "a.run", header(5))[1:] == (None, 0)


def test_backtrack_known_answer() -> None:
    parent = np.array([[-1, -1], [1, 0], [-1, -1], [1, 0], [-1, -1]])
    weight = np.array([[0.9, 0.1], [0.6, 0.4], [0.7, 0.3], [0.2, 0.8], [np.nan, np.nan]])
    # last frame empty; frame 3: best is 1, parent 0; frame 2: mode 0, restart; frame 1: best 0, parent 1
    np.testing.assert_array_equal(backtrack(parent, weight), [1, 0, 0, 1, -1])


def test_packing_is_exact() -> None:
    arrays = {
        "a": np.array([[1.5, np.nan], [np.inf, -0.0]]),
        "text": np.array(["é", "bc"]),
        "none": np.zeros((0, 3), np.float32),
        "one": np.array(7),
        "strided": np.arange(12.0).reshape(3, 4)[:, ::2],
        "yes": np.array([True, False]),
    }
    back = unpack(pack(arrays))
    for name, array in arrays.items():
        assert back[name].dtype == array.dtype
        assert back[name].shape == array.shape
        assert back[name].tobytes() == array.tobytes()
    damaged = bytearray(pack(arrays))
    damaged[-3] ^= 1
    with pytest.raises(ValueError, match="checksum"):
        unpack(bytes(damaged))
    with pytest.raises(TypeError, match="odd"):
        pack({"odd": np.array([None])})


def test_a_number_of_three_bytes_is_refused() -> None:
    blob = pack({"a": np.zeros(3)})
    body = blob[8:].replace(b"<f8", b"<f3")
    with pytest.raises(ValueError, match="array 'a' has no plain type"):
        unpack(blob[:4] + struct.pack("<I", zlib.crc32(body)) + body)


def test_what_a_fit_knew_of_a_pose_is_kept(tmp_path: Path, body: Body) -> None:
    landmarks = len(body.landmark_names)
    seen = [Observation(i, i / 30.0, (), np.zeros((1, landmarks, 2)), np.ones((1, landmarks))) for i in range(5)]
    q, covariance = (
        body.integrate(body.neutral, np.full(body.nv, 0.1)),
        np.diag(np.r_[0.0, np.linspace(0.1, 0.2, body.nv - 1)]),
    )
    file = tmp_path / "a.run"
    with RunWriter.create(file, header(5)) as writer:
        assert Run.open(file).estimates is None
        writer.put_observations(
            [seen[0], dataclasses.replace(seen[1], estimate=PoseEstimate(q, covariance)), *seen[2:]]
        )
    run = Run.open(file)
    assert run.observation(0).estimate is None
    assert run.observation(1).estimate is not None
    assert run.estimates is not None
    ((at, known),) = run.estimates.items()
    assert at == 1
    assert np.array_equal(known.q, q)
    assert np.array_equal(known.covariance, covariance)
    with pytest.raises(InputError, match="other keypoints"):
        RunWriter.resume(file, header(5))[0].put_observations(seen)


def test_resume_refuses_another_run(tmp_path: Path, body: Body) -> None:
    file = tmp_path / "a.run"
    observation = Observation(0, 0.0, (), np.full((1, 3, 2), 5.0), np.ones((1, 3)))
    with RunWriter.create(file, header(5)) as writer:
        writer.put_observations([observation])
        result = walk(body, 1)[0]
        writer.append(result, state_of(result))
    np.testing.assert_array_equal(sqlite3.connect(file).execute("SELECT next FROM state").fetchone(), [1])
    for change, named in (
        ({"seed": 4}, "seed"),
        ({"settings": {"modes": 8, "scale": 0.1}}, "modes"),
        ({"times": np.arange(6) / 30.0}, "frame times"),
        ({"cameras": (guessed_camera("a", (64, 48)),)}, "cameras"),
        ({"version": "0.2"}, "version"),
    ):
        with pytest.raises(InputError, match=named):
            RunWriter.resume(file, header(5, **change))
    with pytest.raises(InputError, match="exists already"):
        RunWriter.create(file, header(5))
    writer, state, position = RunWriter.resume(file, header(5, clips={"a": "elsewhere.mp4"}, notes=("new",)))
    assert position == 1
    assert state is not None
    np.testing.assert_array_equal(state["covariance"], result.covariance)
    writer.put_observations([observation])
    moved = dataclasses.replace(observation, pixels=observation.pixels + 1.0)
    with pytest.raises(InputError, match="frame 0"):
        writer.put_observations([moved])
    second, _, _ = RunWriter.resume(file, header(5))
    second.append(result, {})
    with pytest.raises(InputError, match="another process"):
        writer.append(result, {})
    writer.close()
    second.close()
    with RunWriter.create(file, header(5), overwrite=True):
        assert Run.open(file).frame_count == 0


def test_settings_of_runs_made_before_are_the_same_settings() -> None:
    """Headers once had the tables of all trackers, and some settings had other names."""
    now = {**settings_for("css").to_dict(), "fit": "auto", "person": "auto"}
    css = {k: v for k, v in now["css"].items() if not k.startswith("jump")}
    css |= {"flips": now["css"]["jumps"], "flip_penalty": now["css"]["jump_penalty"]}
    of_others = {name: settings_for(name).to_dict()[name] for name in ("condensation", "annealed")}
    old = now | {"css": css} | of_others
    assert header(5, settings=old).differences(header(5, settings=now)) == ()
    assert header(5, settings=old | {"fit": "off"}).differences(header(5, settings=now)) != ()
    more = now | {"css": now["css"] | {"jumps": now["css"]["jumps"] + 1}}
    (difference,) = header(5, settings=old).differences(header(5, settings=more))
    assert difference.startswith("setting 'css'")
    unknown = header(5, settings=old, tracker="of a plugin")
    assert any("condensation" in d for d in unknown.differences(header(5, settings=now, tracker="of a plugin")))


def test_foreign_and_damaged_files(tmp_path: Path, body: Body) -> None:
    good = tmp_path / "good.run"
    with RunWriter.create(good, header(30)) as writer:
        for result in walk(body, 30):
            writer.append(result, state_of(result))
        writer.finish()
    (tmp_path / "text.run").write_text("no database")
    (tmp_path / "empty.run").touch()
    data = good.read_bytes()
    (tmp_path / "cut.run").write_bytes(data[: len(data) // 2])
    (tmp_path / "stub.run").write_bytes(data[:60])
    (tmp_path / "scrambled.run").write_bytes(data[:4096] + b"\xa5" * (len(data) - 4096))
    sqlite3.connect(tmp_path / "other.run").execute("CREATE TABLE x (y)").connection.close()
    (tmp_path / "newer.run").write_bytes(data)
    newer = sqlite3.connect(tmp_path / "newer.run")
    newer.execute("PRAGMA user_version = 99")
    newer.close()
    for name in ("text", "empty", "cut", "stub", "scrambled", "other", "newer", "absent", "."):
        with pytest.raises(InputError):
            _ = Run.open(tmp_path / f"{name}.run" if name != "." else tmp_path).q
    with pytest.raises(InputError, match="update kinemode"):
        Run.open(tmp_path / "newer.run")
    with pytest.raises(InputError, match="another program"):
        Run.open(tmp_path / "other.run")


WRITERS = """
import os, sys
sys.path[:0] = sys.argv[3:]
from test_run_file import *

file, frames = Path(sys.argv[1]), int(sys.argv[2])
results = walk(Body(load_subject("human34")), frames)


def write(wanted, blocks):
    def block(statement):
        if statement.startswith(blocks):
            print(position, os.getpid(), flush=True)
            while True:
                signal.pause()

    writer, position = RunWriter.resume(file, header(frames))[::2] if file.exists() else (
        RunWriter.create(file, header(frames)), 0)
    for result in results[position:]:
        if position == wanted:
            writer._connection.set_trace_callback(block)  # called before each statement
        writer.append(result, state_of(result))
        position += 1


for line in sys.stdin:
    child = os.fork()  # importing takes longer than everything else
    if not child:
        wanted, _, blocks = line.strip().partition(" ")
        try:
            write(int(wanted), blocks)
        finally:
            os._exit(1)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL is POSIX")
def test_killed_writer_loses_nothing(tmp_path: Path, body: Body) -> None:
    """Between two frames, and in the middle of one: all frames before it are complete, and nothing of it is stored."""
    frames, file, root = 20, tmp_path / "a.run", Path(__file__).parent
    results = walk(body, frames)
    arguments = [sys.executable, "-c", WRITERS, file, str(frames), root, root.parent]
    with subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdin is not None
        assert parent.stdout is not None
        moments = ((7, "BEGIN"), (7, "INSERT INTO frame"), (9, "INSERT OR REPLACE INTO state"), (9, "COMMIT"))
        for wanted, blocks in moments:
            parent.stdin.write(f"{wanted} {blocks}\n")
            parent.stdin.flush()
            position, child = map(int, parent.stdout.readline().split())
            os.kill(child, signal.SIGKILL)
            assert (position, int(parent.stdout.readline())) == (wanted, -signal.SIGKILL)
            run = Run.open(file)
            assert run.frame_count == wanted
            assert_same(run.result(-1), results[wanted - 1])
        parent.communicate(timeout=DEADLINE)
    writer, state, position = RunWriter.resume(file, header(frames))
    assert position == wanted
    assert state is not None
    np.testing.assert_array_equal(state["covariance"], results[wanted - 1].covariance)
    for result in results[position:]:
        writer.append(result, state_of(result))
    writer.finish()
    assert [p.name for p in tmp_path.iterdir()] == ["a.run"]
    for a, b in zip(Run.open(file), results, strict=True):
        assert_same(a, b)
