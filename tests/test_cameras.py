"""Camera files: exact round trip, and every fault named with its place."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from estimator.data.cameras.camera import Camera, guessed_camera
from estimator.data.formats.cameras import load_cameras, write_cameras
from humanoid.support.errors import InputError


def entry(name: str = "a") -> dict[str, Any]:
    return {
        "name": name,
        "image_size": [640, 480],
        "K": [[500.0, 0.0, 320.0], [0.0, 501.0, 240.0], [0.0, 0.0, 1.0]],
        "distortion": [0.1, 0.01, 0.001, 0.002, 0.0],
        "R": [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]],
        "t": [0.0, 1.0, 3.0],
    }


def load(tmp_path: Path, *entries: Any) -> dict[str, Camera]:
    path = tmp_path / "cameras.json"
    path.write_text(json.dumps({"cameras": list(entries)}))
    return load_cameras(path)


def test_round_trip_is_exact(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    cameras = load(tmp_path, entry("a"), entry("b"))
    odd = Camera(
        "c",
        (3, 5),
        cameras["a"].K * [[1 / 3], [np.pi], [1.0]],
        rng.random(5) / 7,
        cameras["b"].R_camera_world,
        rng.random(3),
        focal_std=1 / 7,
        deviations=rng.random((7, 3)) / 7,
    )
    write_cameras(tmp_path / "out.json", [*cameras.values(), odd])
    again = load_cameras(tmp_path / "out.json")
    assert list(again) == ["a", "b", "c"]
    for name in ("K", "distortion", "R_camera_world", "t_camera_world", "image_size", "focal_std", "deviations"):
        np.testing.assert_array_equal(getattr(again["c"], name), getattr(odd, name))


def test_real_file(shared_data: Path) -> None:
    cameras = load_cameras(shared_data / "beam4cam" / "calibration.json")
    assert list(cameras) == ["cam01", "cam02", "cam03", "cam04"]
    assert cameras["cam03"].image_size == (1088, 1920)
    np.testing.assert_allclose(cameras["cam01"].centre_world, [1.460232, -1.909159, 1.896506], atol=1e-5)


def test_short_forms(tmp_path: Path) -> None:
    four = entry() | {"distortion": [1.0, 2.0, 3.0, 4.0]}
    np.testing.assert_array_equal(load(tmp_path, four)["a"].distortion, [1.0, 2.0, 3.0, 4.0, 0.0])
    alone = {k: v for k, v in entry().items() if k not in "Rt"}
    guess = guessed_camera("a", (640, 480))
    np.testing.assert_array_equal(load(tmp_path, alone)["a"].R_camera_world, guess.R_camera_world)
    with pytest.raises(InputError, match=r"cameras\[0\]\.R"):
        load(tmp_path, alone, entry("b"))


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("name", 3),
        ("image_size", [640.5, 480]),
        ("image_size", [0, 480]),
        ("image_size", "640x480"),
        ("K", [[500.0, 0.0], [0.0, 500.0]]),
        ("K", [[-500.0, 0.0, 320.0], [0.0, 501.0, 240.0], [0.0, 0.0, 1.0]]),
        ("K", [[500.0, 0.0, 320.0], [0.0, 501.0, 240.0], [0.0, 0.0, 0.0]]),
        ("K", [[500.0, 0.0, 320.0], [0.0, "x", 240.0], [0.0, 0.0, 1.0]]),
        ("K", [[500.0, 0.0, 320.0], [0.0, 501.0], [0.0, 0.0, 1.0]]),
        ("distortion", [0.0] * 6),
        ("distortion", None),
        ("R", np.diag([1.0, 1.0, -1.0]).tolist()),
        ("R", np.diag([1.0, 1.0, 1.01]).tolist()),
        ("t", [0.0, float("nan"), 0.0]),
        ("t", [0.0, True, None]),
        ("t", [0.0, 0.0]),
        ("focal_std", 1.5),
        ("focal_std", [0.1]),
        ("deviations", [[0.0]] * 6),
        ("deviations", [0.0] * 7),
    ],
)
def test_faults_name_their_place(tmp_path: Path, key: str, value: Any) -> None:
    wrong = copy.deepcopy(entry("b")) | {key: value}
    with pytest.raises(InputError) as caught:
        load(tmp_path, entry("a"), wrong)
    assert caught.value.place == f"cameras[1].{key}"
    assert caught.value.source.endswith("cameras.json")
    del wrong[key]
    if key not in ("distortion", "focal_std", "deviations"):
        with pytest.raises(InputError, match=rf"cameras\[1\]\.{key}: is missing"):
            load(tmp_path, entry("a"), wrong)


def test_other_faults(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="twice"):
        load(tmp_path, entry("a"), entry("a"))
    with pytest.raises(InputError, match="no camera"):
        load(tmp_path)
    with pytest.raises(InputError, match=r"cameras\[0\]: an object"):
        load(tmp_path, 3)
    path = tmp_path / "b.json"
    for text, message in (
        ("", "empty"),
        ('{"cameras": [\n{"name" 3}]}', "line 2"),
        ("[]", "object"),
        ("[" * 10**5, "JSON"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            load_cameras(path)
    path.write_bytes(b"\xff\xfe\x00\x01")
    for bad in (path, tmp_path, tmp_path / "absent.json"):
        with pytest.raises(InputError, match=bad.name):
            load_cameras(bad)
