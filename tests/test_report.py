"""The report of a run is one file with the values of the run."""

from __future__ import annotations

import base64
import hashlib
import json
import shlex
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import kinemode as km
from estimator.data.media.clip import Clip
from estimator.runs.ranges import ranges_of_motion
from estimator.runs.run_header import RunHeader
from estimator.synthesis.settings import ViewSettings
from humanoid.subject.subject import load_subject
from kinemode.__main__ import main
from kinemode.option import words_given
from kinemode.reporting import changed_settings, facts_of, fitted_lengths
from kinemode.request import TrackRequest
from viz.report import pictures
from viz.report.page import page
from viz.report.pictures import Facts, Figure, spans_of
from viz.scene import as_scene

UNSEEN = range(3, 5)  # frames without keypoints


class Reader(HTMLParser):
    """A page's links, its tables as text, and its figures."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.rows: list[list[str]] = []
        self.captions, self.inside = list[str](), ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "poster", "data", "srcset")]
        self.inside = tag
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")
        if tag == "figcaption":
            self.captions.append("")

    def handle_endtag(self, tag: str) -> None:
        self.inside = "figcaption" if tag == "b" and self.inside == "b" else ""

    def handle_data(self, data: str) -> None:
        if self.inside in ("td", "th"):
            self.rows[-1][-1] += data
        elif self.captions and self.inside in ("figcaption", "b"):
            self.captions[-1] += data


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> km.Run:
    """An arm with a clip, not observed for a while."""
    folder = tmp_path_factory.mktemp("report")
    clip = km.render(folder / "clip", "arm", view=ViewSettings(image_size=(160, 120)), fps=10, seconds=0.8)
    keypoints = {}
    for name, path in clip.keypoints.items():
        content = json.loads(Path(path).read_text())
        for t in UNSEEN:
            content["frames"][t] = None
        keypoints[name] = folder / f"{name}.json"
        keypoints[name].write_text(json.dumps(content))
    settings = {"cost": {"nu": 9.0}}
    return km.track(
        clip.subject, clip.videos, keypoints=keypoints, cameras=clip.cameras, out=folder / "arm.run", cues="off",
        seed=5, settings=settings,
    )  # fmt: skip


@pytest.fixture(scope="module")
def text(run: km.Run, tmp_path_factory: pytest.TempPathFactory) -> str:
    return km.report(run, tmp_path_factory.mktemp("page") / "arm.html").read_text(encoding="utf-8")


def test_the_page_needs_no_other_file(text: str) -> None:
    links = Reader(text).links
    assert len(links) > 10
    assert all(link.startswith(("data:", "#")) for link in links)
    assert "url(" not in text
    assert "<script" not in text
    assert "@import" not in text
    assert len(text) < 15e6


def test_the_table_has_the_runs_values(run: km.Run, text: str) -> None:
    """Least and greatest angle in the frames that were seen, with the 90 % intervals of these frames."""
    rows = {row[0]: row[1:] for row in Reader(text).rows if len(row) == 7}
    seen = np.flatnonzero(run.status != "unobserved")
    body = run.body
    assert set(rows) == {"joint", *body.q_names}
    for k, name in enumerate(body.q_names):
        angles = np.rad2deg(run.q[seen, k])
        for cell, t in ((0, int(np.argmin(angles))), (2, int(np.argmax(angles)))):
            angle = run[name].degrees
            ends = [min(angle.low[seen[t]], angles[t]), max(angle.high[seen[t]], angles[t])]
            assert number(rows[name][cell]) == pytest.approx(angles[t], abs=0.051)
            interval = [number(part) for part in rows[name][cell + 1].split(" to ")]
            assert interval == pytest.approx(ends, abs=0.06)
        assert number(rows[name][4]) == pytest.approx(np.ptp(angles), abs=0.051)


def number(cell: str) -> float:
    return float(cell.replace("\N{MINUS SIGN}", "-").rstrip("\N{DEGREE SIGN}"))


def test_intervals_of_ranges_join_both_ends(run: km.Run) -> None:
    """Errors of both frames are taken as independent: squares add."""
    for r in ranges_of_motion(run):
        low, high = r.least, r.greatest
        assert r.range == high.value - low.value
        less = np.hypot(high.value - high.low, low.high - low.value)
        more = np.hypot(high.high - high.value, low.value - low.low)
        assert r.range_low == pytest.approx(max(0.0, r.range - less))
        assert r.range_high <= r.range + more + 1e-12
        assert low.low <= low.value <= low.high


def test_frames_not_to_be_trusted_are_shown(run: km.Run, text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert [str(run.status[t]) for t in UNSEEN] == ["unobserved"] * 2
    captions = Reader(text).captions
    spans = spans_of(tuple(run.status.tolist()))
    assert ("unobserved", 3, 4) in spans
    assert len(captions) == len(spans)
    assert any(caption.startswith("unobserved frames 3 to 4, 0.30 to 0.40 s") for caption in captions)
    assert "too few keypoints" in text
    monkeypatch.setattr(pictures, "MOST_SPANS", 0)
    assert f"{len(spans)} more" in page(run, Facts(), figures=[])


def test_spans_follow_each_other() -> None:
    status = ("hard", "tracked", "hard", "hard", "unobserved", "tracked")
    assert spans_of(status) == [("hard", 0, 0), ("hard", 2, 3), ("unobserved", 4, 4)]
    assert spans_of(("tracked",) * 3) == []


def test_of_many_spans_the_longest_are_shown_by_their_worst_frame(run: km.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    status = ("hard", "tracked", "unobserved", "unobserved", "unobserved", *["tracked"] * (len(run) - 5))
    energy = np.array([9.0, 0.0, 1.0, 3.0, np.nan, *[0.0] * (len(run) - 5)])
    monkeypatch.setattr(pictures, "MOST_SPANS", 1)
    (span,), more = pictures.untrusted(replace(as_scene(run), status=status), energy)
    assert (span.status, span.first, span.last, span.shown, span.count, more) == ("unobserved", 2, 4, 3, 3, 1)


def test_the_film_plays(run: km.Run, text: str, tmp_path: Path) -> None:
    film = next(link for link in Reader(text).links if link.startswith("data:video/mp4;base64,"))
    (tmp_path / "film.mp4").write_bytes(base64.b64decode(film.partition(",")[2]))
    clip = Clip.open(tmp_path / "film.mp4")
    assert sum(1 for _ in clip.frames()) == len(run)
    clip.close()


def test_a_missing_film_is_reported(run: km.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    names = [camera.name for camera in run.header.cameras]
    gone = {name: f"/nowhere/{name}.mp4" for name in names}
    monkeypatch.setattr(run, "header", replace(run.header, clips=gone))
    assert f"The clip of {', '.join(names)} is not where it was" in page(run, Facts(), figures=[])
    facts = facts_of(run)
    assert ("clip of " + names[0], gone[names[0]], "not there any more") in facts.files
    monkeypatch.setattr(run, "header", replace(run.header, clips=dict.fromkeys(names)))
    assert "was not given, only its keypoints" in page(run, Facts(), figures=[])
    monkeypatch.setattr(pictures, "FILM_BYTES", 1)
    long = page(run, Facts(), figures=[])
    assert "too long for a film" in long
    assert "<video" not in long


def test_the_command_of_the_run_is_shown(run: km.Run, text: str) -> None:
    assert changed_settings(run) == [("cost.nu", "9.0", "8.0")]
    facts = facts_of(run)
    assert ("run", str(run.file), hashlib.sha256(run.file.read_bytes()).hexdigest()) in facts.files
    assert "--seed 5" in facts.command
    assert "--settings SETTINGS" in facts.command
    assert "capitals" in facts.blanks
    assert "--cues off" in facts.command
    rows = Reader(text).rows
    assert ["cost.nu", "9.0", "8.0"] in rows
    assert ["kinemode that tracked", km.__version__] in rows


def test_fitted_lengths_are_shown(run: km.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = load_subject("arm8")
    assert not fitted_lengths(run)
    scale = {whole.proportions[0].joint: 1.05}
    monkeypatch.setattr(run, "header", replace(run.header, subject_source="arm8"))
    monkeypatch.setitem(vars(run), "subject", whole.scaled(scale))
    assert dict(fitted_lengths(run))[whole.proportions[0].joint] == pytest.approx(1.05)
    assert any("were fitted to this person" in sentence for sentence in facts_of(run).assumed)


def test_several_cameras_are_shown_with_their_deviations(
    run: km.Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each camera's noise and keypoint distances; with one camera there is nothing to show."""
    assert 'id="cameras"' not in page(run, facts_of(run), figures=[])
    clip = km.render(tmp_path / "clip", "arm", view=ViewSettings(count=2, image_size=(160, 120)), fps=10, seconds=0.4)
    pair = km.track(
        clip.subject, None, keypoints=clip.keypoints, cameras=clip.cameras, out=tmp_path / "a.run", cues="off"
    )
    first, second = pair.header.cameras
    unsure = replace(second, deviations=np.diag([0.01, 0.0, 0.0, 0.0, 0.03, 0.04, 0.05]), focal_std=0.05)
    monkeypatch.setattr(pair, "header", replace(pair.header, cameras=(first, unsure)))
    facts = facts_of(pair)
    rows = {row[0]: row[1:] for row in Reader(page(pair, facts, figures=[])).rows if len(row) == 5}
    focal = f"{first.K[0, 0]:.0f}"
    assert rows[first.name] == ["given", "given", f"{focal}, given", f"{facts.errors[first.name]:.1f}"]
    assert rows[second.name][:3] == ["0.6\N{DEGREE SIGN}", "50.0 mm", f"{focal} \N{PLUS-MINUS SIGN} 5%"]
    for c, camera in enumerate((first, second)):
        off = np.linalg.norm(camera.project(pair.landmarks) - pair.pixels[:, c], axis=2)
        assert facts.errors[camera.name] == pytest.approx(np.nanmedian(off) / np.sqrt(np.log(2.0)), rel=0.05)
        assert f">{camera.name}</text>".encode() in pictures.rig_figure(pair).data


def test_texts_are_escaped_and_figures_can_be_given(run: km.Run) -> None:
    drawn = page(run, Facts(assumed=["a <b> & c"], findings=["see `this`"]), figures=[Figure("x", b"png", "image/png")])
    assert "A &lt;b&gt; &amp; c." in drawn
    assert "<code>this</code>" in drawn
    assert f"data:image/png;base64,{base64.b64encode(b'png').decode()}" in drawn


def test_the_command_writes_what_the_function_writes(
    run: km.Run, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(run.file), "--out", str(tmp_path / "b.html")]) == 0
    assert (tmp_path / "b.html").read_text(encoding="utf-8") == text
    assert main(["report", str(run.file), "--out", str(tmp_path / "b.pdf")]) == 2
    assert "let it end in .html" in capsys.readouterr().err
    assert not (tmp_path / "b.pdf").exists()


def test_the_command_makes_the_run_again(tmp_path: Path) -> None:
    """To the last bit, from any folder, with every given option; its files are listed with their digests."""
    clip = km.render(tmp_path / "clip", "arm", view=ViewSettings(image_size=(160, 120)), fps=10, seconds=0.4)
    (name, keypoints), *_ = clip.keypoints.items()
    settings = tmp_path / "settings.toml"
    settings.write_text("[cost]\nnu = 9.0\n")
    out = tmp_path / "arm.run"
    words = ["--keypoints", f"{name}={keypoints}", "--cameras", str(clip.cameras), "--settings", str(settings)]
    words += ["--start", "0.1", "--floor", "off", "--up=-y", "--keypoint-noise", "2", "--cues", "off", "--seed", "5"]
    line = ["track", str(clip.videos[name]), "--subject", str(clip.subject), *words, "--out", str(out)]
    assert main(line) == 0
    first = km.open_run(out)
    facts = facts_of(first)
    assert facts.blanks == ""
    assert {"settings", "cameras", f"keypoints of {name}"} <= {what for what, _, _ in facts.files}
    again = shlex.split(facts.command)
    assert again[-2:] == ["--out", "arm.run"]
    assert main([*again[1:-1], str(tmp_path / "again.run")]) == 0
    second = km.open_run(tmp_path / "again.run")
    np.testing.assert_array_equal(second.q, first.q)
    assert second.header.request == {**(first.header.request or {}), "out": ("again.run",)}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({}, ""),
        ({"keypoint_size": {"a": (960, 540)}, "up": "-y"}, "--keypoint-size a=960x540 --up=-y"),
        ({"fps": ["a=120", "b=60"]}, "--fps a=120 b=60"),
        ({"floor": "off", "start": 1.5, "layout": "h36m17", "height": 1.7}, "--floor off --start 1.5 --layout h36m17"),
        ({"keypoint_noise": "3", "offset": {"b": -0.2}, "detect": True}, "--keypoint-noise 3 --offset b=-0.2 --detect"),
        ({"cues": ["edges", "flow"], "person": {"a": 1}}, "--cues edges,flow --person a=1"),
        ({"keypoints": {"a": np.zeros((1, 17, 2))}}, "--keypoints a=KEYPOINTS"),
        ({"settings": {"cost": {"nu": 9.0}}}, "--settings SETTINGS"),
        ({"points": [__file__], "markers": "opencap"}, f"--points {__file__} --markers opencap"),
    ],
)  # fmt: skip
def test_the_request_is_kept_and_repeated(
    run: km.Run, monkeypatch: pytest.MonkeyPatch, given: dict[str, object], words: str
) -> None:
    asked = words_given(TrackRequest("human34", **given))
    header = RunHeader.from_json(replace(run.header, request=asked).to_json(), "a.run")
    assert header.request == asked
    monkeypatch.setattr(run, "header", header)
    facts = facts_of(run)
    options = {" ".join(option) for option in _options(shlex.split(facts.command)[2:])}
    assert {" ".join(option) for option in _options(shlex.split(words))} <= options
    assert len(options) == 1 + len(given)  # and the output
    assert bool(facts.blanks) == any(word.rpartition("=")[2].isupper() for word in words.split())


def _options(words: list[str]) -> list[list[str]]:
    """Words of a command line, those of each option together."""
    options: list[list[str]] = []
    for word in words:
        if word.startswith("--"):
            options.append([])
        options[-1].append(word)
    return options


def test_runs_made_before_do_not_know_their_command(run: km.Run, monkeypatch: pytest.MonkeyPatch) -> None:
    old = RunHeader.from_json(replace(run.header, request=None).to_json(), "a.run")
    assert old.request is None
    monkeypatch.setattr(run, "header", old)
    facts = facts_of(run)
    assert facts.command == ""
    assert "earlier version" in facts.blanks
