"""Members of each family by name: a term, a keypoint format, a camera format and an exporter of another package, each
one short file, work in the command line without other edits. Cues and trackers: `test_toy_cue`, `test_toy_tracker`."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

import kinemode as km
import viz.exporters  # noqa: F401 - registers its own
from estimator.data.formats.cameras import CAMERA_FORMATS, load_cameras
from estimator.data.formats.keypoints import KEYPOINT_FORMATS, load_keypoints
from estimator.runs.export import EXPORTERS
from estimator.search.cost_terms import TERMS
from estimator.tracking.registry import TRACKERS
from estimator.vision.cues.settings import CUES
from humanoid.support.errors import InputError
from humanoid.support.plugins import Registry
from kinemode.inputs.motions import MOTION_FORMATS
from tests.builders import body_of
from tests.command_lines import CommandResult, run_with_plugins
from tests.tiny_clip import tiny_clip

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent / "docs"))
import recipes  # noqa: E402

TOYS = ("toy_term", "toy_keypoint_format", "toy_camera_format", "toy_exporter", "toy_motion_format")
MOST_LINES = 60
JOINT, ANGLE = "left_elbow_flexion", 1.25
FAMILIES: Mapping[str, Registry] = {  # type: ignore[type-arg]
    "trackers": TRACKERS,
    "cues": CUES,
    "terms": TERMS,
    "exporters": EXPORTERS,
    "keypoint formats": KEYPOINT_FORMATS,
    "camera formats": CAMERA_FORMATS,
    "motion formats": MOTION_FORMATS,
}


@pytest.mark.parametrize("name", FAMILIES)
def test_members_have_their_own_names_and_another_is_refused(name: str) -> None:
    family = FAMILIES[name]
    assert list(family) == [member.name for member in family.values()]
    first = next(iter(family.values()))
    with pytest.raises(InputError, match=f"already one named {first.name}"):
        family.register(first)
    with pytest.raises(InputError, match=f"one of .*{first.name}"):
        family["no such name"]


@pytest.mark.parametrize("toy", TOYS)
def test_a_new_member_is_one_short_file(toy: str) -> None:
    assert len((HERE / f"{toy}.py").read_text(encoding="utf-8").splitlines()) <= MOST_LINES


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[CommandResult]]:
    """Inputs in formats of another package, tracked with its term and exported in its format; and without the
    package."""
    folder = tmp_path_factory.mktemp("families")
    clip = tiny_clip(folder / "clip", frames=3)
    (camera,) = load_cameras(clip.cameras).values()
    pose = [*camera.R_camera_world.ravel(), *camera.t_camera_world]
    written = " ".join(map(repr, map(float, [*camera.image_size, camera.K[0, 0], *pose])))
    (folder / "cameras.txt").write_text(f"# camera lines\n{camera.name} {written}\n")
    track = load_keypoints(next(iter(clip.keypoints.values())))
    rows = [
        f"{t} {name} {x:.3f} {y:.3f}"
        for t, points in enumerate(track.pixels)
        for name, (x, y) in zip(track.names, points, strict=True)
        if name is not None and np.isfinite(x)
    ]
    (folder / "keypoints.txt").write_text("\n".join(["# keypoints by line", *rows]) + "\n")
    body = body_of("human34")
    places = dict(zip(body.landmark_names, body.landmarks(body.at(body.neutral)), strict=True))
    moved = [f"{0.1 * t} {name} {x} {y} {z + 1.0}" for t in range(3) for name, (x, y, z) in places.items()]
    (folder / "a.motion").write_text("\n".join(moved) + "\n")
    settings = f'[cost.terms.held]\njoint = "{JOINT}"\nangle = {ANGLE}\nstd = 0.001\n'
    (folder / "held.toml").write_text(settings)
    inputs = ["track", "--keypoints", "keypoints.txt", "--cameras", "cameras.txt"]
    inputs = [str(folder / text) if text.endswith(".txt") else text for text in inputs]
    how = ["--fps", "5", "--fit", "off", "--tracker", "single-mode", "--out", str(folder / "a.run")]
    commands = [
        [*inputs, *how, "--settings", str(folder / "held.toml")],
        ["export", str(folder / "a.run"), str(folder / "a.path")],
        ["export", str(folder / "a.run"), str(folder / "a.nothing")],
        ["settings"],
        ["export", str(folder / "a.run"), str(folder / "named.txt"), "--format", "path"],
        ["export", str(folder / "a.run"), str(folder / "other.txt"), "--format", "paths"],
        [
            "retarget",
            str(folder / "a.motion"),
            "--subject",
            "human34",
            "--method",
            "frames",
            "--out",
            str(folder / "m.run"),
        ],
    ]
    return folder, run_with_plugins(*commands, names=",".join(TOYS), path=HERE)


def test_all_of_them_work_in_the_command_line(lines: tuple[Path, list[CommandResult]]) -> None:
    folder, (tracked, exported, refused, settings, named, misnamed, followed) = lines
    assert tracked.code == 0, tracked.error
    run = km.open_run(folder / "a.run")
    column = run.body.q_names.index(JOINT)
    np.testing.assert_allclose(run.filtered_q[:, column], ANGLE, atol=0.01)
    assert run.header.settings["cost"]["terms"]["held"]["joint"] == JOINT
    assert exported.code == 0, exported.error
    assert (folder / "a.path").read_text().startswith("a.path: 3 frames, ")
    assert refused.code == 2
    assert "one of npz, csv, trc" in refused.error
    assert ", path" in refused.error
    assert named.code == 0, named.error
    assert (folder / "named.txt").read_text().startswith("named.txt: 3 frames, ")
    assert misnamed.code == 2
    assert "no export format 'paths' (one of npz, csv, trc" in misnamed.error
    assert ", path" in misnamed.error
    assert followed.code == 0, followed.error
    assert km.open_run(folder / "m.run").frame_count == 3
    table = settings.out.partition("[cost.terms.held]\n")[2].partition("\n\n")[0]
    assert "std = 0.05  # more than 0" in table.splitlines()


def test_recipes_are_what_is_run() -> None:
    """The recipes of CONTRIBUTING, one per family, equal the files here: `python docs/recipes.py` writes them."""
    text = recipes.PAGE.read_text(encoding="utf-8")
    assert recipes.with_recipes(text) == text
    assert recipes.recipes(text) == [
        f"tests/toy_{name}.py"
        for name in ("term", "cue", "tracker", "exporter", "keypoint_format", "camera_format", "motion_format")
    ]
    assert recipes.with_recipes(text.replace("1/2", "1/3")) == text


def test_without_them_their_files_are_refused(lines: tuple[Path, list[CommandResult]]) -> None:
    folder, _ = lines
    with pytest.raises(InputError, match="cameras in a supported format"):
        load_cameras(folder / "cameras.txt")
    with pytest.raises(InputError):
        load_keypoints(folder / "keypoints.txt")
