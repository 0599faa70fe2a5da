"""A marker set template: it has every name of the file, and loads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import kinemode as km
from estimator.data.formats.opensim import write_trc
from humanoid.subject.marker_set import marker_set
from humanoid.support.errors import InputError
from kinemode.__main__ import main

NAMES = ("ann:LASI", "ann:RASI", "ann:R_foo.1", "ann:L_foo.1", 'ann:a"b', "*3", "ann:RGT", "ann:T10")


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_trc(tmp_path / "a.trc", NAMES, np.ones((2, len(NAMES), 3)), np.arange(2) / 100.0)
    return tmp_path / "a.trc"


def test_it_starts_from_what_is_known(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["subjects", "--markers", str(file), "--out", str(tmp_path / "own.toml")]) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'own.toml'}\n"
    own = marker_set(tmp_path / "own.toml")
    assert {marker.name for marker in own.markers} == {"LASI", "RASI", "RGT", "T10"}
    known = {marker.name: marker for name in ("cast", "plug-in-gait") for marker in marker_set(name).markers}
    assert all(marker == known[marker.name] for marker in own.markers)
    assert own.pairs == (("LASI", "RASI"),)
    text = (tmp_path / "own.toml").read_text()
    assert '# "R_foo.1" = {link = ?, xyz = [0, 0, 0], std = 0.03, mirror = "L_foo.1"}' in text
    assert text == km.marker_start(file)
    filled = (
        text.replace('# "a', '"a')
        .replace('# "R_', '"R_')
        .replace('# "L_foo.1" = {link = ?', '"L_foo.1" = {link = "left_foot"')
    )
    (tmp_path / "filled.toml").write_text(filled.replace("link = ?", 'link = "right_foot"'))
    whole = marker_set(tmp_path / "filled.toml")
    assert {marker.name for marker in whole.markers} == {"LASI", "RASI", "RGT", "T10", "R_foo.1", "L_foo.1", 'a"b'}
    km.load_subject("human34").with_markers(whole.markers)


def test_faults_are_one_line(file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="is not a set of markers"):
        km.marker_start(file, begin="nosuch")
    with pytest.raises(InputError, match="no such file"):
        km.marker_start(tmp_path / "b.trc")
    assert km.marker_start(file, begin="cast").count("# cast") == 1
    (tmp_path / "own.toml").write_text("")
    with pytest.raises(InputError, match="nothing is overwritten"):
        km.marker_start(file, out=tmp_path / "own.toml")
    assert main(["subjects", "--markers", str(file), "--landmarks", "human34"]) == 2
    assert "give one of them" in capsys.readouterr().err
