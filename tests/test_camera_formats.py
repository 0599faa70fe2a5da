"""Camera files of other tools: documented examples, beam4cam's cameras in every layout, and what is refused."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import tomli_w

from benchmarks.support.camera_files import toml_sections, write_pose2sim
from estimator.data.cameras.camera import Camera, guessed_camera
from estimator.data.formats.cameras import load_cameras, write_cameras
from estimator.data.formats.cameras_json import camera_to_json
from humanoid.support.errors import InputError
from tests.builders import BROWN, camera_at
from tests.test_lens import LENSES, lens_camera

POSE2SIM = """
[int_cam01_img]
name = "int_cam01_img"
size = [ 1088.0, 1920.0]
matrix = [ [ 1671.5012042021037, 0.0, 564.6403499852015], [ 0.0, 1671.3866928599075, 933.0074897877159],
  [ 0.0, 0.0, 1.0]]
distortions = [ -0.05310342256182765, 0.1510044676505964, -0.00011989435671705446, 0.0006503403122568441]
rotation = [ 1.678784562972848, 1.031972654261743, -0.3910235872501538]
translation = [ 0.2609476905995074, 0.9641586618892432, 2.932963441842366]
fisheye = false

[int_cam04_img]
name = "int_cam04_img"
size = [ 1088.0, 1920.0]
matrix = [ [ 1690.8621773209618, 0.0, 535.7642414457736], [ 0.0, 1689.2410845215763, 933.0004533663628],
  [ 0.0, 0.0, 1.0]]
distortions = [ -0.04718570631606589, 0.10068388229636667, 0.002421622328944551, -0.0010513343762849723]
rotation = [ 1.4051886526650297, -1.3909627084708258, 0.4436653908561921]
translation = [ 0.5111616284766533, 0.11254959801153527, 4.410359951259428]
fisheye = false

[metadata]
adjusted = false
error = 0.0
"""  # two cameras of Pose2Sim's demonstration (BSD 3-Clause)
ANIPOSE = """
[cam_0]
name = "cam088"
size = [ 1440, 1080,]
matrix = [ [ 1850.506308260702, 0.0, 719.5,], [ 0.0, 1850.506308260702, 539.5,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.18925717533695158, 0.0, 0.0, 0.0, 0.0,]
rotation = [ -0.0016129363863306178, -0.002441180452093902, -0.007465964724818265,]
translation = [ 1.623648987402533, -0.601652230518438, 20.748877329963953,]

[cam_1]
name = "cam091"
size = [ 1440, 1080,]
matrix = [ [ 1807.290332446463, 0.0, 719.5,], [ 0.0, 1807.290332446463, 539.5,], [ 0.0, 0.0, 1.0,],]
distortions = [ -0.2128737763749453, 0.0, 0.0, 0.0, 0.0,]
rotation = [ -0.21614575169016556, -2.9760729913237074, 0.39535746473711036,]
translation = [ 116.06725432574943, 257.2440692072561, 1396.7286142164317,]

[metadata]
adjusted = false
error = 0.16285923171540084
"""  # two cameras of aniposelib's tests (BSD 2-Clause), in millimetres
OPENCV = """%YAML:1.0
---
calibration_time: "Tue Nov  7 20:07:31 2017"
image_width: 1280
image_height: 720
flags: 0
{fisheye}camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 6.1885006470610642e+02, 0., 6.3139951850928935e+02, 0.,
       6.2018655433348749e+02, 3.7337227036659061e+02, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: {count}
   dt: d
   data: [ {distortion} ]
avg_reprojection_error: 6.0333912959521829e-01
"""  # as OpenCV's samples/cpp/calibration.cpp and its tutorial write it
QUALISYS = """<?xml version='1.0' encoding='ASCII'?>
<calibration created="2020" source="x.qca" type="regular">
  <cameras>
    <camera active="1" avg-residual="0.45" model="{model}" serial="cam03" viewrotation="{turn}">
      <fov_marker bottom="1919" left="0" right="1087" top="0"/>
      <fov_video bottom="1919" left="0" right="1087" top="0"/>
      <transform r11="-0.740641130147863" r12="-0.6704153360235378" r13="-0.044654154988568895"
        r21="0.25251118212268814" r22="-0.3393170985114385" r23="0.9061467925015139"
        r31="-0.6226466246887545" r32="0.6598539110153292"
        r33="0.4205995683324882" x="-3216.86586729648" y="2231.1786368869416" z="2088.19103027083"/>
      <intrinsic centerPointU="32845.335938" centerPointV="61120.328125" focalLengthU="107622.296875"
        focalLengthV="107616.632813" focallength="9.316" radialDistortion1="-0.046705" radialDistortion2="0.137622"
        radialDistortion3="0.000000" sensorMaxU="{sensor}" sensorMaxV="122816" sensorMinU="0.0" sensorMinV="0.0"
        skew="0.0" tangentalDistortion1="-0.000542" tangentalDistortion2="-0.000517"/>
    </camera>
    <camera active="1" model="Oqus" serial="marker"><fov_marker bottom="1" left="0" right="1" top="0"/></camera>
  </cameras>
</calibration>
"""  # a camera of beam4cam's file, and one that records no video
GOOD = {"model": "Miqus Video", "turn": "0", "sensor": "69568"}


def read(tmp_path: Path, name: str, text: str) -> dict[str, Camera]:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return load_cameras(path)


def test_pose2sim(tmp_path: Path) -> None:
    """As in its `computeP` and `cv2.projectPoints`; the beam lies between the cameras at the world's origin."""
    cameras = read(tmp_path, "Calib_scene.toml", POSE2SIM)
    assert list(cameras) == ["int_cam01_img", "int_cam04_img"]
    camera = cameras["int_cam01_img"]
    assert camera.image_size == (1088, 1920)
    points = np.random.default_rng(0).uniform((-0.5, -0.5, 0.3), (0.5, 0.5, 1.3), (20, 3))
    turn, t = np.array([1.678784562972848, 1.031972654261743, -0.3910235872501538]), camera.t_camera_world
    expected, _ = cv2.projectPoints(points, turn, t, camera.K, camera.distortion[:4])
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-6)
    assert all(1.0 < camera.centre_world[2] < 3.0 for camera in cameras.values())


def test_anipose(tmp_path: Path) -> None:
    """Its unit is that of its board: 1.4 km between cameras is refused; a unit in the file settles it."""
    with pytest.raises(
        InputError, match=r'Anipose TOML: the cameras are 1\d{3} m apart.*units = "mm" below \[metadata'
    ):
        read(tmp_path, "calibration.toml", ANIPOSE)
    cameras = read(tmp_path, "calibration.toml", ANIPOSE + 'units = "mm"\n')
    assert list(cameras) == ["cam088", "cam091"]
    np.testing.assert_allclose(cameras["cam091"].t_camera_world, [0.11606725, 0.25724407, 1.39672861], atol=1e-8)
    with pytest.raises(InputError, match="the unit 'furlong' is unknown"):
        read(tmp_path, "calibration.toml", ANIPOSE + 'units = "furlong"\n')


@pytest.mark.parametrize("model", LENSES)
def test_opencv_yaml(model: str, tmp_path: Path) -> None:
    """Intrinsics alone: the camera stands as a guessed one does, and projects as OpenCV does."""
    lens = LENSES[model]
    fisheye = "fisheye_model: 1\n" if model == "fisheye" else ""
    text = OPENCV.format(fisheye=fisheye, count=len(lens), distortion=", ".join(f"{k:.16e}" for k in lens))
    (camera,) = read(tmp_path, "out_camera_data.yml", text).values()
    assert camera.name == "out_camera_data"
    assert camera.image_size == (1280, 720)
    np.testing.assert_array_equal(camera.R_camera_world, guessed_camera("a", (1280, 720)).R_camera_world)
    points = np.array([[3.0, 0.4, 0.2], [2.0, -0.7, 0.5], [5.0, 1.0, -1.0]])
    turn, none = cv2.Rodrigues(camera.R_camera_world)[0], np.zeros(3)
    project = cv2.fisheye.projectPoints if model == "fisheye" else cv2.projectPoints
    expected, _ = project(points[:, None], turn, none, camera.K, np.array(lens))
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-6)


def test_rostopic_yaml_has_no_tags(tmp_path: Path) -> None:
    text = (
        "image_width: 800\nimage_height: 600\ncamera_name: head\ndistortion_model: plumb_bob\ncamera_matrix:\n"
        "  rows: 3\n  cols: 3\n  data: [538.63, 0, 457.698, 0, 539.723, 297.003, 0, 0, 1]\ndistortion_coefficients:\n"
        "  rows: 1\n  cols: 5\n  data: [-0.30678, 0.0825017, 0.0028784, -0.00015829, 0]\n"
    )
    (camera,) = read(tmp_path, "a.yaml", text).values()
    assert camera.name == "head"
    np.testing.assert_array_equal(camera.K[:2, 2], [457.698, 297.003])
    np.testing.assert_array_equal(camera.distortion, [-0.30678, 0.0825017, 0.0028784, -0.00015829, 0.0])


def test_qualisys(tmp_path: Path) -> None:
    """Known of the scene: where the camera stood, its lens, and that a standing person is upright in it."""
    (camera,) = read(tmp_path, "Calib.qca.txt", QUALISYS.format(**GOOD)).values()
    assert camera.name == "cam03"
    assert camera.image_size == (1088, 1920)
    np.testing.assert_allclose(camera.centre_world, [-3.21686587, 2.23117864, 2.08819103], atol=1e-6)
    np.testing.assert_allclose(camera.K[0, [0, 2]], [1681.59839, 513.20837], atol=1e-4)
    np.testing.assert_array_equal(camera.distortion, [-0.046705, 0.137622, -0.000542, -0.000517, 0.0])
    feet, chest = camera.project(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))  # a person standing at the beam's middle
    assert ((feet > 0) & (feet < camera.image_size)).all()
    assert ((chest > 0) & (chest < camera.image_size)).all()
    assert feet[1] - chest[1] > 300.0


OURS = json.dumps(
    {"units": "m", "cameras": [camera_to_json(camera_at(0.0, distortion=BROWN)) | {"fisheye": False, "note": "of May"}]}
)
WRITERS: dict[str, Callable[[Path, list[Camera]], None]] = {}


def writer(name: str) -> Callable[[Callable[[Path, list[Camera]], None]], Callable[[Path, list[Camera]], None]]:
    def keep(write: Callable[[Path, list[Camera]], None]) -> Callable[[Path, list[Camera]], None]:
        WRITERS[name] = write
        return write

    return keep


@writer("Calib.toml")
def _pose2sim(path: Path, cameras: list[Camera]) -> None:
    write_pose2sim(path, cameras)


@writer("calibration.toml")
def _anipose(path: Path, cameras: list[Camera]) -> None:
    """In millimetres, with a note."""
    sections = {f"cam_{i}": section for i, section in enumerate(toml_sections(cameras).values())}
    for section, camera in zip(sections.values(), cameras, strict=True):
        section["translation"] = (1e3 * camera.t_camera_world).tolist()
    path.write_text(tomli_w.dumps(sections | {"metadata": {"adjusted": False, "error": 0.1, "units": "mm"}}))


def _storage(path: Path, cameras: list[Camera]) -> None:
    """By OpenCV itself."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for c in cameras:
        file.startWriteStruct(c.name, cv2.FileNode_MAP)
        file.write("image_width", c.image_size[0])
        file.write("image_height", c.image_size[1])
        file.write("camera_matrix", c.K)
        file.write("distortion_coefficients", c.distortion[:, None])
        file.write("fisheye_model", int(c.fisheye))
        file.write("rvec", cv2.Rodrigues(c.R_camera_world)[0])
        file.write("tvec", c.t_camera_world[:, None])
        file.endWriteStruct()
    file.release()


for _ending in ("yml", "json", "xml"):
    WRITERS[f"cameras.{_ending}"] = _storage


@writer("calib.qca.txt")
def _qualisys(path: Path, cameras: list[Camera]) -> None:
    lines = ["<calibration><cameras>"]
    for c in cameras:
        table = np.diag([1.0, -1.0, -1.0]) @ c.R_camera_world
        turn = " ".join(f'r{i + 1}{k + 1}="{table[i, k]!r}"' for i in range(3) for k in range(3)).replace(
            "np.float64", ""
        )
        x, y, z = 1e3 * c.centre_world
        k1, k2, p1, p2, k3 = c.distortion
        (w, h), K = c.image_size, 64.0 * c.K
        lines += [
            f'<camera active="1" serial="{c.name}" model="none" viewrotation="0">',
            f'<fov_video left="0" top="0" right="{w - 1}" bottom="{h - 1}"/>',
            f'<transform x="{x:.12g}" y="{y:.12g}" z="{z:.12g}" {turn.replace("(", "").replace(")", "")}/>',
            f'<intrinsic focalLengthU="{K[0, 0]:.12g}" focalLengthV="{K[1, 1]:.12g}" centerPointU="{K[0, 2]:.12g}"',
            f' centerPointV="{K[1, 2]:.12g}" skew="{K[0, 1]:.12g}" sensorMaxU="{64 * w - 1}" sensorMaxV="{64 * h - 1}"',
            f' radialDistortion1="{k1:.12g}" radialDistortion2="{k2:.12g}" radialDistortion3="{k3:.12g}"',
            f' tangentalDistortion1="{p1:.12g}" tangentalDistortion2="{p2:.12g}"/></camera>',
        ]
    path.write_text("\n".join([*lines, "</cameras></calibration>"]))


@writer("ours.json")
def _ours(path: Path, cameras: list[Camera]) -> None:
    write_cameras(path, cameras)


@writer("camera_array.toml")
def _caliscope(path: Path, cameras: list[Camera]) -> None:
    """Rotations as matrices, with a camera that is left out and unused members."""
    sections = {
        c.name.removeprefix("cam_"): {
            "cam_id": i, "rotation_count": -1, "error": 0.2, "ignore": False, "size": list(c.image_size),
            "matrix": c.K.tolist(), "distortions": c.distortion.tolist(), "translation": c.t_camera_world.tolist(),
            "rotation": c.R_camera_world.tolist(), "fisheye": c.fisheye, "verified_resolutions": [[640, 480]],
        }
        for i, c in enumerate(cameras)
    }  # fmt: skip
    ignored = {**next(iter(sections.values())), "ignore": True}
    path.write_text(tomli_w.dumps({"cameras": {**sections, "99": ignored}}))


@writer("panoptic.json")
def _panoptic(path: Path, cameras: list[Camera]) -> None:
    entries = [
        {
            "name": c.name, "type": "hd", "resolution": list(c.image_size), "panel": 0, "node": i, "K": c.K.tolist(),
            "distCoef": c.distortion.tolist(), "R": c.R_camera_world.tolist(),
            "t": (100.0 * c.t_camera_world)[:, None].tolist(),
        }
        for i, c in enumerate(cameras)
    ]  # fmt: skip
    path.write_text(json.dumps({"calibDataSource": "160422", "cameras": entries}))


@writer("extri.yml")
def _easymocap(path: Path, cameras: list[Camera]) -> None:
    halves = {}
    for part in ("intri", "extri"):
        halves[part] = cv2.FileStorage(str(path.with_name(f"{part}.yml")), cv2.FILE_STORAGE_WRITE)
        halves[part].startWriteStruct("names", cv2.FileNode_SEQ)
        for c in cameras:
            halves[part].write("", c.name)
        halves[part].endWriteStruct()
    for c in cameras:
        halves["intri"].write(f"K_{c.name}", c.K)
        halves["intri"].write(f"dist_{c.name}", c.distortion[None])
        halves["intri"].write(f"W_{c.name}", c.image_size[0])
        halves["intri"].write(f"H_{c.name}", c.image_size[1])
        halves["extri"].write(f"R_{c.name}", cv2.Rodrigues(c.R_camera_world)[0])
        halves["extri"].write(f"Rot_{c.name}", c.R_camera_world)
        halves["extri"].write(f"T_{c.name}", c.t_camera_world[:, None])
    for half in halves.values():
        half.release()


FITS = {"calib.qca.txt": "Brown's model", "extri.yml": "no fisheye", "panoptic.json": "no fisheye"}
"""Lens models that these formats support."""


def check_round(tmp_path: Path, layout: str, cameras: list[Camera], points: np.ndarray) -> None:
    """Written and read, cameras see points at the same pixels; projections with a NaN in both are equal."""
    WRITERS[layout](tmp_path / layout, cameras)
    again = load_cameras(tmp_path / layout)
    assert list(again) == [c.name for c in cameras]
    for camera in cameras:
        assert again[camera.name].image_size == camera.image_size
        np.testing.assert_allclose(again[camera.name].project(points), camera.project(points), atol=1e-6)


@pytest.mark.parametrize("layout", WRITERS)
def test_every_layout_keeps_the_pixels(layout: str, tmp_path: Path) -> None:
    points = np.random.default_rng(1).normal(scale=0.6, size=(40, 3))
    cameras = [camera_at(20.0, distortion=BROWN), replace(camera_at(110.0), distortion=np.zeros(5))]
    lenses = [lens_camera(model, 40.0 * i) for i, model in enumerate(LENSES) if i > 1]
    cameras += [c for c in lenses if layout not in FITS or (FITS[layout] == "no fisheye" and not c.fisheye)]
    check_round(tmp_path, layout, [replace(c, name=f"cam_{i}") for i, c in enumerate(cameras)], points)


@pytest.mark.parametrize("layout", WRITERS)
def test_real_cameras_in_every_layout(layout: str, tmp_path: Path, shared_data: Path) -> None:
    real = load_cameras(shared_data / "beam4cam" / "calibration.json").values()
    cameras = [replace(c, name=f"cam_{i}") for i, c in enumerate(real)]
    points = np.load(shared_data / "beam4cam" / "reference3d.npz")["points"].reshape(-1, 3)
    check_round(tmp_path, layout, cameras, points)


KALIBR = """{name}:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: {coefficients}
  distortion_model: {model}
  intrinsics: [{fx}, {fy}, {cx}, {cy}]
  resolution: [{width}, {height}]
  rostopic: /c/image_raw
"""


def kalibr(cameras: list[Camera]) -> str:
    """A chain of cameras, each placed by the one before it."""
    text, before = "", None
    for i, c in enumerate(cameras):
        lens = {"model": "equidistant" if c.fisheye else "radtan", "coefficients": c.distortion[:4].tolist()}
        (fx, _, cx), (_, fy, cy), _ = c.K.tolist()
        size = dict(zip(("width", "height"), c.image_size, strict=True))
        text += KALIBR.format(name=f"cam{i}", fx=fx, fy=fy, cx=cx, cy=cy, **lens, **size)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = c.R_camera_world, c.t_camera_world
        text += "" if before is None else f"  T_cn_cnm1: {(T @ np.linalg.inv(before)).tolist()}\n"
        before = T
    return text


def test_kalibr(tmp_path: Path) -> None:
    """Cameras in the frame of the first one."""
    brown, fisheye = np.append(BROWN[:4], 0.0), lens_camera("fisheye", 75.0)
    cameras = [camera_at(20.0, distortion=brown), camera_at(110.0, focal=710.0, distortion=brown), fisheye]
    cameras = [replace(c, K=c.K * (1.0 - np.eye(3, k=1))) for c in cameras]  # Kalibr's has no skew
    first, points = cameras[0], np.random.default_rng(3).normal(scale=0.6, size=(40, 3))
    again = read(tmp_path, "camchain.yaml", kalibr(cameras))
    assert list(again) == ["cam0", "cam1", "cam2"]
    in_first = points @ first.R_camera_world.T + first.t_camera_world
    for camera, seen in zip(cameras, again.values(), strict=True):
        np.testing.assert_allclose(seen.project(in_first), camera.project(points), atol=1e-6)
    (alone,) = read(tmp_path, "camchain.yaml", kalibr(cameras[:1])).values()
    assert np.array_equal(alone.K, first.K)


def test_either_file_of_easymocap_stands_for_both(tmp_path: Path) -> None:
    cameras = [replace(camera_at(20.0 + 60.0 * i), name=name) for i, name in enumerate(("01", "02", "010"))]
    _easymocap(tmp_path / "extri.yml", cameras)
    both = [load_cameras(tmp_path / f"{part}.yml") for part in ("intri", "extri")]
    assert [list(c) for c in both] == [["01", "02", "010"]] * 2
    (tmp_path / "intri.yml").unlink()
    with pytest.raises(
        InputError, match=r"extri\.yml: has only half of the camera parameters: intri\.yml is not beside it"
    ):
        load_cameras(tmp_path / "extri.yml")


@pytest.mark.parametrize("layout", ["ours.json", "camera_array.toml", "extri.yml", "cameras.yml", "calibration.toml"])
def test_lengths_implausible_as_metres_are_refused(layout: str, tmp_path: Path) -> None:
    cameras = [camera_at(20.0, distance=3.1), replace(camera_at(110.0, distance=4.3), name="b")]
    far = [replace(c, t_camera_world=1e3 * c.t_camera_world, name=f"cam_{i}") for i, c in enumerate(cameras)]
    WRITERS[layout](tmp_path / layout, far)
    if layout == "calibration.toml":  # the writer's own unit
        text = (tmp_path / layout).read_text().replace('units = "mm"', "")
        (tmp_path / layout).write_text(text)
    with pytest.raises(InputError, match=r"the cameras are \d+ m apart"):
        load_cameras(tmp_path / layout)


def test_our_own_file_may_declare_its_unit(tmp_path: Path) -> None:
    camera = camera_at(20.0, distance=3.1)
    entry = camera_to_json(replace(camera, t_camera_world=1e3 * camera.t_camera_world))
    (again,) = read(tmp_path, "a.json", json.dumps({"units": "mm", "cameras": [entry]})).values()
    np.testing.assert_allclose(again.t_camera_world, camera.t_camera_world, atol=1e-12)


def test_the_real_qualisys_file(shared_data: Path) -> None:
    """The published conversion, of the two cameras with pictures of the original size."""
    folder = shared_data / "beam4cam"
    read_now, published = load_cameras(folder / "Calib.qca.txt"), load_cameras(folder / "calibration_qualisys.json")
    points = np.load(folder / "reference3d.npz")["points"].reshape(-1, 3)
    for name in ("cam03", "cam04"):
        assert np.nanmax(np.abs(read_now[name].project(points) - published[name].project(points))) < 0.01


def test_a_stereo_pair(tmp_path: Path) -> None:
    """Intrinsics and extrinsics of `cv2.stereoCalibrate` in one file: the first camera is the origin."""
    a, b = camera_at(20.0, distortion=BROWN), camera_at(40.0)
    R = b.R_camera_world @ a.R_camera_world.T
    parts = {"M1": a.K, "D1": a.distortion, "M2": b.K, "D2": b.distortion, "R": R}
    parts["T"] = b.t_camera_world - R @ a.t_camera_world
    entry = {key: value.tolist() for key, value in parts.items()}
    text = json.dumps(entry | {"image_width": 640, "image_height": 480})
    first, second = read(tmp_path, "stereo.json", text).values()
    x = np.array([0.1, 0.2, 0.3])
    in_first = a.R_camera_world @ x + a.t_camera_world
    np.testing.assert_allclose(first.project(in_first), a.project(x), atol=1e-9)
    np.testing.assert_allclose(second.project(in_first), b.project(x), atol=1e-9)
    with pytest.raises(InputError, match="OpenCV JSON: has the intrinsics of a pair without R and T"):
        read(tmp_path, "intrinsics.json", json.dumps({k: v for k, v in entry.items() if k not in "RT"}))


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.toml", POSE2SIM.replace("matrix =", "matriks =", 1), r"\[int_cam01_img\]\.matrix: is missing"),
        ("a.toml", POSE2SIM.replace("[ 1.678784562972848,", "[ ", 1), r"Pose2Sim TOML, \[int_cam01_img\]\.rotation"),
        ("a.toml", POSE2SIM.replace("translation", "moved", 1), r"\[int_cam01_img\]\.translation: is missing"),
        ("a.toml", POSE2SIM.replace("size =", "sighs =", 1), r"\.size: is missing"),
        ("a.toml", POSE2SIM.replace("fisheye = false", "fisheye = 3", 1), "true or false"),
        ("a.toml", POSE2SIM.replace("06503403122568441]", "06, 3.0, 1.0]"), r"\.distortions: 4, 5, 8, 12 or 14 coeff"),
        ("a.toml", "[project]\nframes = 3\n", "Pose2Sim TOML: has no camera"),
        ("a.toml", "[cam_0]\nmatrix = [", "is not TOML"),
        ("a.yml", "%YAML:1.0\n---\nimage_width: 3\n", "OpenCV YAML: has no camera_matrix, but image_width"),
        ("a.yml", OPENCV.format(fisheye="", count=5, distortion="1, 2"), "_coefficients: rows, cols and data"),
        ("a.yml", OPENCV.format(fisheye="", count=3, distortion="1, 2, 3"), "OpenCV YAML.*4, 5, 8, 12 or 14 coeff"),
        ("a.yml", OPENCV.format(fisheye="", count=1, distortion="[1"), r"line \d+: is not YAML"),
        ("a.yml", OPENCV.replace("image_w", "w").format(fisheye="", count=4, distortion="0,0,0,0"), "image_width"),
        ("a.yml", "a: &x [1]\nb: *x\n", "aliases"),
        ("a.yml", "[" * 100_000, "is not (usable )?YAML"),
        ("a.xml", QUALISYS.format(**GOOD | {"turn": "90"}), "Qualisys calibration, camera cam03: its view is turned"),
        ("a.xml", QUALISYS.format(**GOOD | {"sensor": "1087"}), "not a sensor in 1/64 pixels"),
        ("a.xml", QUALISYS.format(**GOOD).replace("fov_video", "fov"), "<fov_video> is missing"),
        ("a.xml", QUALISYS.format(**GOOD).replace("focalLengthU", "f"), "focalLengthU"),
        ("a.xml", QUALISYS.format(**GOOD).replace('active="1"', 'active="0"'), "Qualisys calibration: has no"),
        ("a.xcp", "<Cameras/>", "Vicon"),
        ("a.xml", "<robot/>", "read are OpenCV JSON, kinemode JSON"),
        ("a.txt", "1 2 3", "read are OpenCV JSON, kinemode JSON"),
        ("a.json", '{"a": 1}', "read are OpenCV JSON, kinemode JSON"),
        ("a.json", OURS.replace("distortion", "distCoef"), r"cameras\[0\]: the member 'distCoef' is unknown \("),
        ("a.json", OURS.replace('"fisheye"', '"fish_eye"'), r"'fish_eye' is unknown \(did you mean fisheye"),
        ("a.json", OURS.replace('"units"', '"unit"'), r"'unit' is unknown \(did you mean units"),
        ("a.toml", POSE2SIM.replace("distortions", "distortion"), r"'distortion' is unknown \(did you mean dist"),
        ("a.yml", OPENCV.replace("distortion_co", "distortion_of_co").format(fisheye="", count=4, distortion="0,0,0,0"),
         "OpenCV YAML: the member 'distortion_of_coefficients' is unknown"),
        ("a.yaml", kalibr([camera_at(0.0)]).replace("pinhole", "omni"), r"YAML, cam0\.camera_model: 'omni' is not"),
        ("a.yaml", kalibr([camera_at(0.0)]).replace("radtan", "fov"), r"cam0\.distortion_model: 'fov' is not read"),
        ("a.yaml", kalibr([camera_at(0.0)] * 2).replace("T_cn_cnm1", "T"), r"Kalibr YAML, cam1\.T_cn_cnm1: is missing"),
    ],
)  # fmt: skip
def test_faults_name_format_and_place(name: str, text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message) as caught:
        read(tmp_path, name, text)
    assert "\n" not in str(caught.value)
    assert caught.value.source.endswith(name)


def test_pickles_are_never_loaded(tmp_path: Path) -> None:
    """Neither by their ending nor by their content."""

    class Trap:
        def __reduce__(self) -> tuple[object, ...]:
            return (Path.touch, (tmp_path / "sprung",))

    for name in ("cameraIntrinsicsExtrinsics.pickle", "cameras.json"):
        (tmp_path / name).write_bytes(pickle.dumps(Trap()))
        with pytest.raises(InputError, match=r"pickle, as OpenCap writes.*convert it with Pose2Sim"):
            load_cameras(tmp_path / name)
    assert not (tmp_path / "sprung").exists()


def test_intrinsics_of_several_cameras_give_no_placements(tmp_path: Path) -> None:
    """Pose2Sim writes zeros where it has calibrated the lenses alone."""
    cameras = [
        replace(camera_at(a), name=f"c{a:g}", R_camera_world=np.eye(3), t_camera_world=np.zeros(3)) for a in (0, 9)
    ]
    WRITERS["Calib.toml"](tmp_path / "Calib.toml", cameras)
    with pytest.raises(InputError, match="all 2 cameras are at one place: the file has only intrinsics"):
        load_cameras(tmp_path / "Calib.toml")
