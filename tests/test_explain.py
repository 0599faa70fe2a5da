"""Sums of an explanation, and what it shows."""

from __future__ import annotations

import json
import shutil
import sqlite3
import warnings
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import kinemode as km
from estimator.data.formats.packing import pack, unpack
from estimator.inference.origin import Family
from estimator.runs.run_reader import Run
from estimator.tracking.registry import make_tracker, settings_for
from estimator.vision.cues.learned import with_learned
from estimator.vision.cues.reader import CueReader
from estimator.vision.visibility import OUTER
from humanoid.support.errors import InputError
from kinemode import __main__ as front
from kinemode.explain import cue_reader, explain, run_settings
from kinemode.rendering import RenderedClip
from tests.tiny_clip import QUICK, named
from viz import palette
from viz.cue_pictures import LONGEST, cue_pictures

FRAMES, END = 4, 0.7  # at 5 per second


@pytest.fixture(scope="module")
def runs(clip: RenderedClip, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Run]:
    """One run from keypoints alone, one from the pictures."""
    folder = tmp_path_factory.mktemp("runs")
    both = {"settings": {**QUICK, "smooth": {"enabled": False}}, "fit": "off", "end": END}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return {
            "keypoints": km.track(
                "human34", None, cameras=clip.cameras, keypoints=clip.keypoints, out=folder / "k.run", **both
            ),
            "pictures": km.track("human34", **named(clip), mask=clip.masks, out=folder / "p.run", **both),
            "lifted": km.track(
                "human34", None, cameras=clip.cameras, keypoints=with_world(clip, folder), out=folder / "l.run", **both
            ),
        }


def with_world(clip: RenderedClip, folder: Path) -> Path:
    """The clip's keypoints with an arbitrary lifted pose."""
    (path,) = clip.keypoints.values()
    content, rng = json.loads(path.read_text()), np.random.default_rng(0)
    for frame in content["frames"]:
        if frame["keypoints"]:
            frame["world"] = rng.normal(0.0, 0.4, (len(frame["keypoints"]), 3)).tolist()
    (folder / path.name).write_text(json.dumps(content))
    return folder / path.name


@pytest.mark.parametrize("name", ["keypoints", "lifted"])
def test_the_parts_of_a_run_from_keypoints_add_up_to_its_energies(runs: dict[str, Run], name: str) -> None:
    run = runs[name]
    assert (run.observation(0).lifted is not None) == (name == "lifted")
    for t in range(FRAMES):
        for k in range(len(run.result(t).weight)):
            explained = explain(run, t, k)
            assert explained.total == pytest.approx(run.mode_energy[t, k], abs=1e-9)
            assert explained.notes == ()
            assert ("transition" in [p.name for p in explained.parts]) == (t > 0)
            lifted = run.observation(t).lifted
            counts = lifted is not None and lifted.share == 1.0
            assert [p.energy > 0.0 for p in explained.parts if p.name == "lifted"] == [True] * counts
            assert all(p.energy >= 0.0 for p in explained.parts if p.name != "pose prior")
    (keypoints,) = [p for p in explain(run, 1).parts if p.name == "keypoints"]
    assert keypoints.count == np.count_nonzero(run.confidence[1])
    assert 0.0 < keypoints.distance < 3.0


def test_the_parts_of_a_picture_are_all_there_is(clip: RenderedClip, runs: dict[str, Run]) -> None:
    """Their sum is the energy that the cost model assembles from all cues and penalties together."""
    run, t = runs["pictures"], 2
    settings = settings_for("css", changes=QUICK)
    search = make_tracker("css", run.body, settings).search
    dt = run.time[t] - run.time[t - 1]
    ((name, video),) = clip.videos.items()
    reader = CueReader([video], run.header.cameras, settings.cues, masks=[clip.masks[name]])
    result, before, origins = run.result(t), run.result(t - 1), run.result(t).origins
    observation = with_learned(replace(run.observation(t), cues=reader.at(t)), result.extra)
    reader.close()
    assert origins is not None
    parent = int(result.parent[0])
    predicted = run.body.integrate(before.q[parent], settings.own.momentum * dt * run.mode_velocity[t - 1, parent])
    np.testing.assert_array_equal(origins.q_previous[0], before.q[parent])
    np.testing.assert_array_equal(origins.q_predicted[0], predicted)
    likelihood = search.likelihood(observation, before.q[0])
    assigned = likelihood.assigned(run.body.at(origins.q_assigned[0]))
    flow = likelihood.followed(run.body.at(before.q[parent]), run.body.at(predicted))
    whole = search.model.cost(search.term(observation, result.association[0]), before.q[parent], dt, [*assigned, *flow])
    explained = explain(run, t, 0)
    assert explained.total == pytest.approx(whole.of(run.body.at(result.q[0])).value, rel=1e-9)
    assert explained.total == pytest.approx(run.mode_energy[t, 0], abs=1e-9)
    parts = {p.name: p for p in explained.parts}
    for name in ("edges", "body to silhouette", "silhouette to body", "colour", "flow", "anchors"):
        assert parts[name].count
        assert 0.0 < parts[name].distance < 5.0


JUMPING = {
    "css": {
        "modes": 5,
        "samples": 2,
        "jumps": 12,
        "limb_samples": 12,
        "jump_penalty": 1.0,
        "limb_penalty": 1.0,
        "budget": {"searches": 24},
    },
    "cost": {"exchange_penalty": 0.2},
    "cues": {"working_size": 160},
    "smooth": {"enabled": False},
}
"""Settings that, with the seed below, keep hypotheses of every family."""


@pytest.fixture(scope="module")
def jumping(clip: RenderedClip, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Run]:
    """As `runs`, with jumps, and one from both."""
    folder = tmp_path_factory.mktemp("jumping")
    seen: dict[str, Any] = {
        "keypoints": {"clips": None, "cameras": clip.cameras, "keypoints": clip.keypoints},
        "pictures": {**named(clip), "mask": clip.masks},
        "both": {**named(clip), "keypoints": clip.keypoints, "mask": clip.masks, "cues": "edges,flow,silhouette"},
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return {
            name: km.track("human34", **how, settings=JUMPING, fit="off", end=END, seed=2, out=folder / f"{name}.run")
            for name, how in seen.items()
        }


def test_energies_of_jumped_and_exchanged_hypotheses_add_up(jumping: dict[str, Run]) -> None:
    kept = set()
    for name, run in jumping.items():
        for t in range(FRAMES) if name == "keypoints" else (FRAMES - 1,):  # pictures are slow
            for k in range(len(run.result(t).weight)):
                explained = explain(run, t, k)
                assert explained.total == pytest.approx(run.mode_energy[t, k], abs=1e-9)
                assert explained.notes == ()
                assert explained.origin is not None
                kept |= {explained.origin.family, explained.association}
    assert kept >= {"start", "parent", "sample", "kinematic jump", "limb elsewhere", "as_detected", "exchanged"}


def test_a_jump_has_no_motion_energy_but_its_penalty(jumping: dict[str, Run]) -> None:
    run, jumps = jumping["keypoints"], 0
    for t in range(1, FRAMES):
        result, before = run.result(t), run.result(t - 1)
        assert result.origins is not None
        for k in range(len(result.weight)):
            origin = result.origins.of_mode(k)
            assert origin.transition_from is not None
            parent, jumped = before.q[result.parent[k]], origin.family is Family.DEPTH_JUMP
            assert np.array_equal(origin.transition_from, parent) != jumped
            assert origin.penalty == (1.0 if jumped else 0.0)
            change = run.body.difference(origin.transition_from, result.q[k])
            np.testing.assert_allclose(run.mode_velocity[t, k], change / (run.time[t] - run.time[t - 1]))
            jumps += jumped
            if jumped:
                assert np.abs(run.body.difference(parent, origin.transition_from)).max() > 0.1
    assert jumps > 0


def test_a_run_without_stored_penalties(
    runs: dict[str, Run], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "old.run"
    shutil.copy(runs["pictures"].file, path)
    with sqlite3.connect(path) as connection:
        for position, data in connection.execute("SELECT position, data FROM frame").fetchall():
            kept = {n: a for n, a in unpack(data).items() if n != "velocity" and not n.startswith("origin_")}
            connection.execute("UPDATE frame SET data = ? WHERE position = ?", (pack(kept), position))
    old = Run.open(path)
    assert old.result(2).origins is None
    assert np.isnan(old.mode_velocity).all()
    explained = explain(old, 2, 0)
    assert not {"transition", "flow"} & {p.name for p in explained.parts}
    assert explained.total > 0.0
    assert any("does not store its hypotheses' previous poses" in note for note in explained.notes)
    assert front.main(["explain", str(path), "--frame", "2"]) == 0
    assert "searched as" not in capsys.readouterr().out


def test_pictures_show_the_body_where_it_is(runs: dict[str, Run]) -> None:
    (view,) = explain(runs["pictures"], 1).views
    assert view.prediction is not None
    reader = cue_reader(runs["pictures"], run_settings(runs["pictures"]))
    (silhouette,) = (cues["silhouette"] for cues in reader.at(1))
    reader.close()
    outer = np.round(view.prediction.contours.pixels[view.prediction.contours.state == OUTER]).astype(int)
    assert np.abs(silhouette.distance[outer[:, 1], outer[:, 0]]).mean() < 3.0
    pictures = dict(cue_pictures(view))
    of_cues = {"edges", "motion_boundaries", "flow", "silhouette", "colour", "anchors"}
    assert set(pictures) == {"keypoints", "visibility"} | of_cues
    for picture in pictures.values():
        assert LONGEST <= max(picture.shape) <= LONGEST + 40
    assert (np.abs(pictures["silhouette"].astype(int) - palette.bgr(palette.GOOD)).sum(axis=2) < 30).sum() > 200


def test_command_prints_the_table_and_writes_the_pictures(
    runs: dict[str, Run], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for run, count in ((runs["keypoints"], 1), (runs["pictures"], 8)):
        out = tmp_path / run.file.stem
        assert front.main(["explain", str(run.file), "--frame", "1", "--out", str(out)]) == 0
        printed = capsys.readouterr().out
        assert all(word in printed for word in ("keypoints", "transition", "sum", "as the run has it", "searched as"))
        assert ("edges" in printed) == (count > 1)
        written = sorted(out.iterdir())
        assert len(written) == count
        assert all(cv2.imread(str(path)) is not None for path in written)


def test_missing_frames_and_hypotheses(clip: RenderedClip, runs: dict[str, Run], tmp_path: Path) -> None:
    run = runs["pictures"]
    for frame in (-1, FRAMES):
        with pytest.raises(InputError, match=f"has no frame {frame}.*0 to {FRAMES - 1}"):
            explain(run, frame)
    with pytest.raises(InputError, match=r"no hypothesis 9.*--hypothesis 0 to"):
        explain(run, 1, 9)
    (tmp_path / "file").touch()
    assert front.main(["explain", str(run.file), "--frame", "1", "--out", str(tmp_path / "file" / "x")]) == 2
    (video,) = clip.videos.values()
    moved = shutil.copy(run.file, tmp_path / "moved.run")
    with closing(sqlite3.connect(moved, isolation_level=None)) as connection:
        (header,) = connection.execute("SELECT json FROM header").fetchone()
        assert str(video) in header
        connection.execute("UPDATE header SET json = ?", (header.replace(str(video), str(tmp_path / "away.mp4")),))
    with pytest.raises(InputError, match=r"away\.mp4"):
        explain(Run.open(moved), 1)
    assert len(explain(runs["keypoints"], 1).parts) > 3


def test_frames_without_an_observation_of_their_own(clip: RenderedClip, tmp_path: Path) -> None:
    late = write_late(clip, tmp_path / "late.json")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        run = km.track(
            "human34",
            None,
            cameras=clip.cameras,
            keypoints=late,
            fit="off",
            settings=QUICK,
            end=END,
            out=tmp_path / "l.run",
        )
    assert run.status.tolist() == ["unobserved", "tracked", "unobserved", "tracked"]
    with pytest.raises(InputError, match=r"before the first pose.*--frame 1"):
        explain(run, 0)
    with pytest.raises(InputError, match=r"those of frame 1.*--frame 1"):
        explain(run, 2)
    assert explain(run, 3, 0).total == pytest.approx(run.mode_energy[3, 0], abs=1e-9)  # its parents were carried over


def test_a_run_made_before_is_explained_with_its_own_settings(runs: dict[str, Run], tmp_path: Path) -> None:
    """Headers once had the tables of all trackers, and some settings had other names."""
    path = tmp_path / "old.run"
    shutil.copy(runs["keypoints"].file, path)
    connection = sqlite3.connect(path, isolation_level=None)
    header = json.loads(connection.execute("SELECT json FROM header").fetchone()[0])
    css = header["settings"]["css"]
    css["flips"], css["flip_penalty"] = css.pop("jumps"), css.pop("jump_penalty")
    header["settings"]["annealed"] = settings_for("annealed").to_dict()["annealed"]
    connection.execute("UPDATE header SET json = ?", (json.dumps(header),))
    connection.close()
    old = Run.open(path)
    assert run_settings(old) == run_settings(runs["keypoints"])
    assert explain(old, 2, 0).parts == explain(runs["keypoints"], 2, 0).parts


def write_late(clip: RenderedClip, path: Path) -> Path:
    """Keypoints of every other frame, the first without."""
    (source,) = clip.keypoints.values()
    content = json.loads(source.read_text())
    content["frames"] = [frame if i % 2 else None for i, frame in enumerate(content["frames"])]
    path.write_text(json.dumps(content))
    return path
