"""Errors of the public functions for arguments of the wrong kind."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinemode as km
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError

ARGUMENTS: dict[str, tuple[dict[str, Any], str]] = {
    "a model": ({"subject": "MODEL"}, "subject: cannot be of type pinocchio.Model .give a subject from load_subject"),
    "no subject": ({"subject": None}, "subject: cannot be None"),
    "frames": ({"clips": np.zeros((2, 4, 4, 3))}, "clips: frame 0: has the shape .4, 4, 3. and type float64"),
    "keypoints": ({"keypoints": np.zeros((2, 17, 3))}, "keypoints: has no person in any frame"),
    "a number among files": ({"keypoints": ["a.json", 3]}, "keypoints: cannot be of type list"),
    "numbers by name": ({"mask": {"a": 1.5}}, "mask: cannot be of type dict"),
    "intrinsics": ({"cameras": np.eye(3)}, "cameras: cannot be of type numpy.ndarray .give the path of a camera file"),
    "settings": ({"settings": 7}, "settings: cannot be of type int .7. .give a nested mapping"),
    "a text of modes": ({"modes": "7"}, "modes: cannot be of type str .'7'. .give a whole number"),
    "modes": ({"modes": 10**9}, "modes: 1000000000 hypotheses cannot be kept"),
    "seed": ({"seed": 0.5}, "seed: cannot be of type float .0.5. .give a whole number"),
    "negative seed": ({"seed": -1}, "seed: must be 0 or more, got -1"),
    "cues": ({"cues": 3}, "cues: cannot be of type int"),
    "fit": ({"fit": np.zeros(2)}, "fit: cannot be of type numpy.ndarray"),
    "person": ({"person": 1.5}, "person: cannot be of type float"),
    "out": ({"out": 3}, "out: cannot be of type int"),
    "resume": ({"resume": "no"}, "resume: cannot be of type str"),
    "progress": ({"progress": 3}, "progress: cannot be of type int"),
}


@pytest.mark.parametrize("name", ARGUMENTS)
def test_arguments_in_the_wrong_place(name: str, tmp_path: Path) -> None:
    given, message = ARGUMENTS[name]
    (tmp_path / "empty.json").write_text("{}")  # arguments are checked before files
    how: dict[str, Any] = {
        "subject": "arm8",
        "clips": None,
        "keypoints": tmp_path / "empty.json",
        "out": tmp_path / "a.run",
    } | given
    if how["subject"] == "MODEL":
        how["subject"] = load_subject("arm8").model
    with pytest.raises(InputError, match=message):
        km.track(**how)
    if next(iter(given)) not in ("settings", "modes", "fit", "resume", "progress"):
        with pytest.raises(InputError, match=message):
            km.fit(**how)
    with pytest.raises(InputError, match=message):
        km.compare(trackers="css", **(how | {"out": given.get("out", tmp_path / "all")}))


@pytest.mark.parametrize("function", [km.open_run, km.load_subject])
@pytest.mark.parametrize("value", [None, 3, np.zeros(3), b"arm8", ["arm8"]])
def test_what_is_opened_is_a_path(function: Callable[[Any], Any], value: Any) -> None:
    with pytest.raises(InputError, match=r"cannot be .*give .*path of"):
        function(value)


LATER: dict[str, tuple[Callable[..., Any], tuple[Any, ...], dict[str, Any], str]] = {
    "no run": (km.view, (None,), {}, "run: cannot be None .give a run, or the path of a run file"),
    "port": (km.view, ("a.run",), {"port": "80"}, "port: cannot be of type str"),
    "no film": (km.overlay, ("a.run", 3), {}, "file: cannot be of type int .3. .give the path of a file to write"),
    "camera": (km.overlay, ("a.run", "a.mp4"), {"camera": 0}, "camera: cannot be of type int .0. .give the name"),
    "format": (km.export, ("a.run", "a.csv"), {"format": 3}, "format: cannot be of type int"),
    "seed of a stream": (km.Retargeter, ("arm8", ["a"]), {"seed": -1}, "seed: must be 0 or more, got -1"),
    "points": (km.evaluate, ("a.run", np.zeros((2, 12, 3))), {}, "reference: cannot be of type numpy.ndarray"),
    "no folder": (km.render, (None,), {}, "folder: cannot be None"),
    "scene": (km.render, ("a",), {"scene": {"noise": 0}}, "scene: cannot be of type dict .give kinemode.SceneSettings"),
    "masks": (km.render, ("a",), {"masks": "no"}, "masks: cannot be of type str"),
    "body": (km.render, ("a",), {"subject": 34}, "subject: cannot be of type int"),
    "frames": (km.annotate, (np.zeros((4, 4, 3)),), {}, "clip: cannot be of type numpy.ndarray .give the path"),
    "clicks": (km.annotate, ("a.mp4",), {"keypoints": ["a.json"]}, "keypoints: cannot be of type list"),
}


@pytest.mark.parametrize("name", LATER)
def test_arguments_of_what_comes_before_and_after(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    function, given, how, message = LATER[name]
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=message):
        function(*given, **how)
    assert list(tmp_path.iterdir()) == []
