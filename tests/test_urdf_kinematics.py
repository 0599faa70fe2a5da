"""Links of a URDF are where forward kinematics in numpy places them, for all joint types and followers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchmarks.robustness.urdfs import NEAR, Deviation, deviation, main, outcome, sources
from humanoid.kinematics.body import Body
from humanoid.subject.subject import Base, load_subject
from humanoid.support.errors import InputError

KINDS = ("revolute", "continuous", "prismatic", "planar", "floating", "fixed")


def urdf(rng: np.random.Generator, *, kinds: tuple[str, ...] = KINDS) -> str:
    """A tree with a joint of every type in random places, and a chain of followers, whose master comes last."""
    parents = [int(rng.integers(k + 1)) for k in range(len(kinds))]
    joints = [
        joint(rng, kind, f"l{p}", f"l{k + 1}", kind) for k, (kind, p) in enumerate(zip(kinds, parents, strict=True))
    ]
    chain = (
        ("a_third", "prismatic", "b_second"),
        ("b_second", "continuous", "c_first"),
        ("c_first", "revolute", "drive"),
    )
    for name, kind, master in chain:
        factor, offset = rng.uniform(0.2, 0.5, 2)
        follows = f'<mimic joint="{master}" multiplier="{factor}" offset="{0.1 * offset}"/>'
        joints.append(joint(rng, kind, "l0", f"of_{name}", name, follows))
    joints.append(joint(rng, "revolute", "l1", "of_drive", "drive"))
    links = [f"l{k}" for k in range(len(kinds) + 1)] + ["of_a_third", "of_b_second", "of_c_first", "of_drive"]
    return f'<robot name="r">{"".join(f"""<link name="{link}"/>""" for link in links)}{"".join(joints)}</robot>'


def joint(rng: np.random.Generator, kind: str, parent: str, child: str, name: str, follows: str = "") -> str:
    xyz, rpy, axis = (" ".join(map(str, row)) for row in rng.normal(size=(3, 3)))
    axis = "0 0 2" if kind == "planar" else axis
    limit = "" if kind == "continuous" else '<limit lower="-1.2" upper="1.4" effort="1" velocity="1"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}{follows}</joint>'
    )


def compared(tmp_path: Path, text: str, *, base: Base = "auto", expected: str = "") -> Deviation:
    """The project's placements of a file and numpy's, of the same or another text."""
    (tmp_path / "r.urdf").write_text(text)
    body = Body(load_subject(tmp_path / "r.urdf", base=base))
    links, worst = deviation(body, (expected or text).encode(), 4, np.random.default_rng(1))
    assert links == text.count("<link ")
    return worst


@pytest.mark.parametrize("base", ["free", "fixed"])
@pytest.mark.parametrize("seed", range(3))
def test_every_type_of_joint_is_posed_after_the_specification(tmp_path: Path, seed: int, base: Base) -> None:
    worst = compared(tmp_path, urdf(np.random.default_rng(seed)), base=base)
    assert 0.0 < max(worst.place, worst.turn) <= NEAR


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('rpy="', 'rpy="-'),
        ('<axis xyz="', '<axis xyz="-'),
        ('offset="', 'offset="1'),
        ('multiplier="', 'multiplier="1'),
        ('<mimic joint="b_second"', '<mimic joint="drive"'),
        ('type="prismatic"', 'type="revolute"'),
    ],
)
def test_planted_faults_are_seen(tmp_path: Path, old: str, new: str) -> None:
    text = urdf(np.random.default_rng(2))
    worst = compared(tmp_path, text, expected=text.replace(old, new).replace("--", ""))
    assert worst.place > 1e-2
    assert worst.place_of


def test_files_are_posed_refused_or_at_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "good.urdf").write_text(urdf(np.random.default_rng(5)))
    (tmp_path / "robot.urdf.xacro").write_text("<robot><xacro:include/></robot>")
    (tmp_path / "notes.txt").write_text("no URDF")
    files = sources([tmp_path])[tmp_path.name]
    assert [called for _, called in files] == ["good.urdf", "robot.urdf.xacro"]
    good, xacro = (outcome(path, called, 2, 0) for path, called in files)
    assert (good.posed, xacro.posed) == (True, False)
    assert xacro.refusal.startswith("robot.urdf.xacro: ")
    assert "is xacro" in xacro.refusal
    monkeypatch.setattr("benchmarks.robustness.urdfs.load_subject", lambda *_, **__: {}["no such key"])
    assert "KeyError" in outcome(*files[0], 2, 0).fault


@pytest.mark.parametrize("options", [{"poses": 0}, {"folders": (Path("nowhere"),)}])
def test_bad_options_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(InputError, match=r"--poses: is 0|nowhere: is not a folder"):
        main(**options)  # type: ignore[arg-type]
