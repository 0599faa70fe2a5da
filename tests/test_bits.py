"""Bits compared: the same code gives equal bits, and differences are found."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.robustness import bits
from benchmarks.robustness.bits_cases import INPUT, RESULT
from humanoid.support.errors import InputError


@pytest.mark.paper
def test_a_second_run_is_equal_and_another_seed_is_not(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, arrays = tmp_path / "bits.json", tmp_path / "arrays"
    bits.main(write=file, keep=arrays, cases=("css",), frames=3)
    written = json.loads(file.read_text())["cases"]["css"]
    assert written["frames"] == 3
    assert set(written["arrays"]) == {*INPUT, *RESULT} - {"pictures"}
    stored = {path: path.read_bytes() for path in arrays.iterdir()}
    bits.main(compare=file, keep=arrays)
    assert "1 of 1 cases equal" in capsys.readouterr().out
    with pytest.raises(SystemExit) as ended:
        bits.main(compare=file, keep=arrays, cases=("css",), seed=1)
    printed = capsys.readouterr().out
    assert ended.value.code == 1
    assert "different: css" in printed
    assert "keypoints" not in printed  # they are the clip's
    assert {path: path.read_bytes() for path in arrays.iterdir()} == stored


def test_a_hash_is_of_kind_shape_and_every_bit() -> None:
    array = np.array([[0.0, np.nan], [1.0, 2.0]])
    assert bits.digest(array) == bits.digest(np.asfortranarray(array)) == bits.digest(array.copy())
    others = [array.T, array.ravel(), array.astype(np.float32), array * [[-1.0, 1.0], [1.0, 1.0]]]
    others += [np.nextafter(array, 3.0), array.view(np.int64)]
    assert len({bits.digest(other) for other in (array, *others)}) == 1 + len(others)


def test_differences_are_named_and_measured(tmp_path: Path) -> None:
    old, new = tmp_path / "old", tmp_path / "new"
    q, weight = np.array([[0.0, np.nan]]), np.ones(2)
    before = {"q": q, "mode_q": q, "covariance": weight, "mode_weight": weight}
    after = {"q": q + 0.25, "mode_q": q * np.nan, "covariance": weight[:1], "mode_weight": weight}
    for folder, arrays in ((old, before), (new, after)):
        folder.mkdir()
        np.savez(folder / "css.npz", **arrays)
    records = []
    for folder in (old, new):
        with np.load(folder / "css.npz") as kept:
            hashes = {name: bits.digest(array) for name, array in kept.items()}
        records.append({"css": {"frames": 1, "seed": 0, "arrays": hashes | {"pictures": folder.name}}})
    differ = {"pictures": "", "q": "2.5e-01", "mode_q": "other entries are NaN", "covariance": "(2,) to (1,)"}
    assert bits.compared(*records, old, new) == {"css": differ}
    assert bits.compared(*records, None, new) == {"css": dict.fromkeys(differ, "")}
    assert bits.compared(records[0], records[0], old, old) == {"css": {}}


def test_cases_that_cannot_run_are_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("KINEMODE_DATA", str(tmp_path))
    assert bits.chosen_cases(("cam01", "css"), None, None) == ["css"]
    assert "cam01: skipped, the clip beam4cam is not here" in capsys.readouterr().err
    with pytest.raises(InputError, match=r"no case 'cam05'.*one of demo, .*cam01"):
        bits.main(write=tmp_path / "a.json", cases=("cam05",))
    (tmp_path / "b.json").write_text("[]")
    with pytest.raises(InputError, match="has no hashes"):
        bits.main(compare=tmp_path / "b.json")
    for wrong in ({}, {"write": tmp_path / "a", "compare": tmp_path / "a"}, {"compare": tmp_path / "a", "frames": 3}):
        with pytest.raises(InputError, match="--"):
            bits.main(**wrong)
