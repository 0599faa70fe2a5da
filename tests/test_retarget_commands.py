"""The commands that show and measure runs, on one that was made from another motion."""

from __future__ import annotations

import threading
import urllib.request
from pathlib import Path

import numpy as np
import pytest

import kinemode as km
from kinemode.__main__ import main
from kinemode.reporting import motion_figures
from tests.made_motion import made_motion
from viz.local_server import LocalServer
from viz.preview.live import serve

pytestmark = pytest.mark.usefixtures("few_figures")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> km.Run:
    return made_motion(tmp_path_factory.mktemp("made"))


def test_the_report_has_the_figures_in_place_of_cameras(run: km.Run, tmp_path: Path) -> None:
    text = km.report(run, tmp_path / "a.html").read_text(encoding="utf-8")
    for name, value in motion_figures(run).rows():
        assert f"<td>{name}</td><td>{value}</td>" in text
    assert "made from bend.npz" in text
    assert "90&nbsp;%" not in text
    assert "tracker" not in text.split("<main>")[1]
    assert "<video" in text


def test_the_live_page_has_the_source(run: km.Run) -> None:
    texts: list[str] = []

    def visit(server: LocalServer, address: str) -> None:
        def load() -> None:
            try:
                with urllib.request.urlopen(address) as response:
                    texts.append(response.read().decode())
            finally:
                server.shutdown()

        threading.Thread(target=load).start()

    serve(run, open_browser=False, ready=visit)
    assert '"source: sticks"' in texts[0]


@pytest.mark.parametrize(
    ("words", "printed"),
    [
        ("explain RUN --frame 3", "was made from another motion, not tracked (open it with kinemode view)"),
        ("samples RUN --out OUT.png", "it has no posterior to draw poses from (kinemode overlay draws it)"),
        ("plot RUN --out OUT.png", None),
        ("contact RUN --out OUT.csv --plot OUT.png", None),
        ("gait RUN --out OUT.csv", None),
        ("evaluate RUN --reference REFERENCE", None),
        ("view RUN --html OUT.html", None),
        ("report RUN --out OUT.html", None),
        ("overlay RUN --out OUT.gif", None),
        ("overlay RUN --out OUT.mp4 --limbs", "loose-limbed"),
        *((f"export RUN OUT.{name}", None) for name in ("npz", "csv", "trc", "mot", "osim", "c3d", "bvh", "glb")),
        ("export RUN OUT.csv --degrees --filter 6", None),
        ("export RUN OUT.npz --format motion-npz", None),
        ("export RUN OUT.csv --format motion-csv", None),
    ],
)
def test_every_command_works_or_explains_in_one_line(
    words: str, printed: str | None, run: km.Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reference = km.export(run, tmp_path / "reference.npz")
    named = {"RUN": str(run.file), "OUT": str(tmp_path / "out"), "REFERENCE": str(reference)}
    for word, value in named.items():
        words = words.replace(word, value)
    code, error = main(words.split()), capsys.readouterr().err
    if printed is None:
        assert code == 0, error
        return
    assert code != 0
    assert printed in error.replace("\n", " ")
    assert "Traceback" not in error


def test_a_body_without_feet_has_no_figures_of_a_floor(run: km.Run, tmp_path: Path) -> None:
    match = tmp_path / "arm.toml"
    match.write_text(
        '[match]\nscale = 1.0\n[limbs]\nleft_upper_arm = {from = "left_shoulder", to = "left_elbow"}\n',
        encoding="utf-8",
    )
    arm = km.retarget(run, "arm8", match=match, out=tmp_path / "arm.run")
    rows = dict(motion_figures(arm).rows())
    assert "joints over their limits" in rows
    assert not {"below the floor", "slip of what stands", "hips off the scaled path"} & set(rows)
    assert not any("nan" in value for value in rows.values())
    text = km.report(arm, tmp_path / "arm.html").read_text(encoding="utf-8")
    assert "The subject has no feet" in text
    with np.load(km.export(arm, tmp_path / "arm.npz", format="motion-npz")) as file:
        assert "root_position" not in file.files
