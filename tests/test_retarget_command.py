"""`kinemode retarget` from end to end, and its error messages."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from estimator.retargeting.run_of import source_of
from estimator.retargeting.source import SourceMotion
from estimator.runs.run_reader import Run
from tests.command_lines import CommandResult, run_here
from tests.test_retarget_sources import smpl
from tests.test_retargeting import part_of, steps

FRAMES, RATE = 15, 30.0


@cache
def joints() -> np.ndarray:
    """(T, 24, 3) [m] in SMPL's order of a person who steps."""
    return smpl(part_of(steps(), 10, 10 + FRAMES))


@pytest.fixture
def walk(tmp_path: Path) -> Path:
    np.savez(tmp_path / "walk.npz", joints=joints(), fps=RATE)
    return tmp_path / "walk.npz"


def retargeted(*words: object, subject: str = "human34") -> CommandResult:
    return run_here(["retarget", *words, "--subject", subject, "--seed", 3])


def arms(folder: Path) -> Path:
    """A motion of shoulders, elbows and wrists alone, in a file of points."""
    source = part_of(steps(), 10, 10 + FRAMES)
    names = [f"{side}_{part}" for side in ("left", "right") for part in ("shoulder", "elbow", "wrist")]
    chosen = source.points[:, [source.names.index(name) for name in names]]
    np.savez(folder / "arms.npz", points=chosen, names=np.array(names), fps=RATE, up="z", unit="m")
    return folder / "arms.npz"


def test_from_joints_to_a_run_and_its_figures(walk: Path, tmp_path: Path) -> None:
    out, table = tmp_path / "b.run", tmp_path / "b.csv"
    printed = retargeted(walk, "--up", "z", "--out", out, "--metrics", table)
    assert printed.code == 0, printed.error
    assert printed.out.splitlines()[-2:] == [str(table), str(out)]
    assert "frames: 15, 0.0% of them hard" in printed.out
    run = Run.open(out)
    assert run.header.retargeted
    assert run.header.seed == 3
    assert run.time == pytest.approx(np.arange(FRAMES) / RATE)
    assert set(source_of(run)[0].names) > {"left_hip", "right_big_toe"}
    figures = dict(csv.reader(table.open(encoding="utf-8")))
    assert (float(figures["over_limits"]), float(figures["too_fast"]), figures["frames"]) == (0.0, 0.0, "15")
    assert float(figures["limb_angle"]) < 4.0
    again = retargeted(walk, "--out", out)
    assert (again.code, again.error.count("\n")) == (2, 1)
    assert "exists already" in again.error
    assert retargeted(walk, "--up", "z", "--out", out, "--overwrite", "--method", "frames").code == 0


def test_a_correspondence_template_is_written_and_used(walk: Path, tmp_path: Path) -> None:
    match = tmp_path / "match.toml"
    begun = run_here(["retarget", "--match", "human34", "--out", match])
    assert (begun.code, begun.out) == (0, f"{match}\n")
    assert run_here(["retarget", "--match", "human34", "--out", match]).code == 2
    text = match.read_text().replace("# [match]\n# scale = 1.0", "[match]\nscale = 0.9")
    match.write_text("\n".join(line for line in text.splitlines() if not line.startswith("head =")))
    printed = retargeted(walk, "--up", "z", "--match", match, "--out", tmp_path / "a.run")
    assert printed.code == 0, printed.error
    assert Run.open(tmp_path / "a.run").header.settings["scale"] == 0.9


def test_without_feet_the_floor_is_off(tmp_path: Path) -> None:
    """A motion of arms alone is followed in the air, with a note."""
    match = tmp_path / "match.toml"
    sides = [f'{s}_arm = {{from = "{s}_shoulder", to = "{s}_wrist"}}' for s in ("left", "right")]
    match.write_text("[match]\nscale = 1.0\n[limbs]\n" + "\n".join(sides))
    printed = retargeted(arms(tmp_path), "--match", match, "--out", tmp_path / "a.run")
    assert printed.code == 0, printed.error
    assert "no feet: nothing is held on a floor" in printed.error
    assert "below the floor" not in printed.out
    assert Run.open(tmp_path / "a.run").header.floor is None


def faulty(folder: Path, walk: Path, name: str) -> list[object]:
    """The words of a command line with a fault."""
    if name == "nan":
        np.savez(walk, joints=np.full_like(joints(), np.nan), fps=RATE)
    elif name == "scale":
        return [arms(folder)]
    elif name == "landmark":
        (folder / "match.toml").write_text('[limbs]\nleft_thigh = {from = "left_hip", to = "knee"}')
        return [walk, "--match", folder / "match.toml"]
    elif name == "common":
        points = np.zeros((3, 2, 3)) + np.arange(3.0)[:, None, None] + np.arange(2.0)[:, None]
        np.savez(walk, points=points, names=np.array(["left_eye", "nose"]), fps=RATE, up="z", unit="m")
    return {
        "missing": [folder / "none.npz"], "nothing": [], "no_match": [walk, "--match", folder / "none.toml"],
        "velocity": [walk, "--velocity", 0], "fast": [walk, "--velocity", 1.5],
        "clearance": [walk, "--clearance", -1], "folder": [walk, "--metrics", folder / "none" / "a.csv"],
    }.get(name, [walk])  # fmt: skip


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("missing", "none.npz: there is no such file"),
        ("nothing", "nothing to retarget"),
        ("no_match", "none.toml: there is no such file"),
        ("nan", "all are NaN"),
        ("common", "no limb is named alike"),
        ("scale", "show how large the subject is"),
        ("landmark", "match.toml: limb left_thigh: the subject has no landmark knee"),
        ("velocity", "velocity"),
        ("fast", "velocity"),
        ("clearance", "clearance"),
    ],
)
def test_a_fault_is_one_line(walk: Path, tmp_path: Path, name: str, message: str) -> None:
    printed = retargeted(*faulty(tmp_path, walk, name), "--out", tmp_path / "a.run")
    assert printed.code == 2
    errors = [line for line in printed.error.splitlines() if line.startswith("error")]
    assert len(errors) == 1, printed.error
    assert message in errors[0].replace("'", "")
    assert printed.error.splitlines()[-1] == errors[0]
    assert not (tmp_path / "a.run").exists()


def test_a_subject_without_the_limbs(walk: Path, tmp_path: Path) -> None:
    urdf = tmp_path / "box.urdf"
    urdf.write_text('<robot name="box"><link name="a"/><landmark name="a" link="a" xyz="0 0 0"/></robot>')
    printed = retargeted(walk, "--up", "z", "--out", tmp_path / "a.run", subject=str(urdf))
    assert (printed.code, printed.out) == (2, "")
    assert printed.error.count("\n") == 1


def test_a_program_that_has_landmarks() -> None:
    """`SourceMotion` in, a temporary run out."""
    import kinemode as km

    source = part_of(steps(), 0, 5)
    run = km.retarget(SourceMotion(source.names, source.points, source.times, "here"), "human34", method="frames")
    assert run.q.shape == (5, 35)
    with pytest.raises(km.InputError, match="show how large the subject is"):
        km.retarget(SourceMotion(source.names, np.full((5, 26, 3), np.nan), source.times, "here"), "human34")
