"""Valid files of every kind that is read, small, to be damaged: by reader, a list of folders as name -> content."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import kinemode as km
from benchmarks.robustness.c3d_files import c3d_file
from benchmarks.robustness.fuzz_limbs import templates, two_limbs
from benchmarks.robustness.fuzz_texts import ARM, ARM_LANDMARKS, ARM_MESHES, BVH_CMU, BVH_PLAIN, DAE, LIMBS, OBJ
from benchmarks.robustness.hdf5_files import deeplabcut_fixed_h5, deeplabcut_h5, sleap_h5
from estimator.data.cameras.camera import Camera, guessed_camera
from estimator.data.formats.keypoints import KeypointTrack, write_keypoints
from estimator.data.formats.opensim import write_trc
from estimator.runs.export import export
from estimator.trackers.loose_limbed.limbs.potentials import SHIPPED
from humanoid.kinematics.body import Body
from humanoid.subject.landmarks import FORMATS
from humanoid.subject.subject import URDF_FOLDER, load_subject
from kinemode.progress import Progress
from kinemode.settings import describe_settings

Files = Mapping[str, bytes]
SIZE = (64, 48)
FRAMES = 3
QUICK: dict[str, Any] = {"css": {"samples": 1, "jumps": 0, "modes": 2, "budget": {"searches": 4}}}
"""Settings that make a track short."""
ANNEALED: dict[str, Any] = {"tracker": "annealed", "settings": {"annealed": {"layers": 2, "particles": 6, "modes": 2}}}


def corpus(subjects: Sequence[str] = ("arm8", "upper13")) -> dict[str, list[Files]]:
    """All of it, with runs of some subjects; the first name of each folder is the file that is read."""
    with tempfile.TemporaryDirectory(prefix="kinemode-fuzz-") as name:
        folder = Path(name)
        return {
            **_keypoints(), **_texts(), **_subjects(), **_limbs(folder), **_pictures(folder),
            **_runs(folder, subjects),
        }  # fmt: skip


def points(layout: str, frame: int) -> np.ndarray:
    """(J, 3) someone's keypoints in a frame: spread over the image, moving a little."""
    rng = np.random.default_rng(len(FORMATS[layout]))
    xy = rng.uniform(0.2, 0.8, (len(FORMATS[layout]), 2)) * SIZE + 0.5 * frame
    return np.round(np.column_stack([xy, rng.uniform(0.3, 1.0, len(xy))]), 2)


def _json(value: Any) -> bytes:
    return json.dumps(value).encode()


def _own(layout: str) -> dict[str, Any]:
    frames: list[Any] = [{"keypoints": points(layout, t).tolist()} for t in range(FRAMES - 1)]
    return {"format": layout, "image_size": list(SIZE), "fps": 30.0, "frames": [*frames, {"keypoints": None}]}


def _keypoints() -> dict[str, list[Files]]:
    named = {**_own("coco17"), "format": "detector", "names": [n or f"k{i}" for i, n in enumerate(FORMATS["coco17"])]}
    alpha = [
        {"image_id": f"{t}.jpg", "keypoints": points("halpe26", t).ravel().tolist(), "score": 2.9, "idx": [who]}
        for t in range(FRAMES) for who in range(2)
    ]  # fmt: skip
    cmu = {f"{t}.jpg": {"bodies": [{"joints": points("coco18", t).ravel().tolist()}]} for t in range(FRAMES)}
    seen = points("coco17", 0)
    instance = [{"keypoints": seen[:, :2].tolist(), "keypoint_scores": seen[:, 2].tolist()}]
    frames = [{"frame_id": t + 1, "instances": 2 * instance} for t in range(FRAMES)]
    pose = [{"person_id": [-1], "pose_keypoints_2d": points("body25", t).ravel().tolist()} for t in range(FRAMES)]
    folders = [
        {f"walk_{t:012d}_keypoints.json": _json({"version": 1.3, "people": [pose[t], pose[0]]}) for t in range(FRAMES)}
    ]
    others = _other_programs()
    people = {**_own("coco17"), "frames": [
        {"people": [{"id": who, "keypoints": points("coco17", t).tolist(), "world": [[0.1, -0.2, 0.3]] * 17}
                    for who in range(2)]}
        for t in range(FRAMES)
    ]}  # fmt: skip
    whole = [_own("coco17"), _own("mediapipe33"), people, named, alpha, cmu, frames,
             {"meta_info": {}, "instance_info": frames}, {"people": pose}]  # fmt: skip
    landmarks = [mark.name for mark in load_subject("human34").landmarks]
    values = np.round(np.random.default_rng(0).uniform(0, 40, (FRAMES, len(landmarks), 2)), 2)
    clicks = {
        "format": "landmarks", "image_size": list(SIZE), "fps": 30.0, "names": landmarks,
        "frames": [{"keypoints": [[*xy, 1.0] for xy in frame]} for frame in values.tolist()],
    }  # fmt: skip
    page = {str(t): dict(zip(landmarks, np.pad(values[t], ((0, 0), (0, 1)), constant_values=1.0).tolist(), strict=True))
            for t in range(FRAMES)}  # fmt: skip
    return {
        "keypoints": [{"keypoints.json": _json(content)} for content in [*whole, clicks]],
        "keypoint folder": list(folders),
        "clicks": [{"clicks.json": _json(clicks)}],
        "page": [{"page.json": _json(page)}],
        **others,
    }


def _other_programs() -> dict[str, list[Files]]:
    """Keypoints as DeepLabCut, annotation tools, rtmlib, Ultralytics and NumPy write them."""
    p = np.array([points("coco17", t) for t in range(FRAMES)])
    ids = [{"id": t + 5, "file_name": f"{t:06d}.png", "width": SIZE[0], "height": SIZE[1]} for t in range(FRAMES)]
    shown = [{"image_id": t + 5, "category_id": 1, "keypoints": p[t].ravel().tolist()} for t in range(FRAMES)]
    category = {"id": 1, "name": "person", "keypoints": list(FORMATS["coco17"])}
    frames = [{"keypoints": 2 * [xyc[:, :2].tolist()], "scores": 2 * [xyc[:, 2].tolist()]} for xyc in p]
    whole = {key: [frame[key] for frame in frames] for key in ("keypoints", "scores")}
    arrays = {"keypoints": p[..., :2], "scores": p[..., 2], "names": np.array(FORMATS["coco17"]), "fps": np.array(30.0)}
    alone = io.BytesIO()
    np.save(alone, p)
    renamed = _json({"snout": "nose", "left_eye": "left_eye"})
    return {
        "deeplabcut": [
            {"walk.csv": _deeplabcut(p, ("",)), "walk.names.json": renamed},
            {"walk.csv": _deeplabcut(p, ("ann", "bob"))},
        ],
        "keypoint h5": [{"walk.h5": content, "walk.names.json": renamed} for content in _hdf5(p)],
        "coco": [{"coco.json": _json({"images": ids, "annotations": shown, "categories": [category]})}],
        "rtmlib": [{"people.json": _json(content)} for content in (frames, whole)],
        **_ultralytics(p),
        "keypoint arrays": [{"points.npz": npz(arrays)}, {"points.npz": npz({"keypoints": p[:, None]})}],
        "keypoint array": [{"points.npy": alone.getvalue(), "points.names.json": _json(FORMATS["coco17"])}],
    }


def _ultralytics(p: np.ndarray) -> dict[str, list[Files]]:
    """The same points (T, 17, 3) of one tracked person as JSON and as labels."""
    head = {"name": "person", "class": 0, "confidence": 0.9, "box": {"x1": 1.0, "y1": 1.0, "x2": 9.0, "y2": 9.0}}
    frames = [
        [{**head, "track_id": 3, "keypoints": dict(zip(("x", "y", "visible"), xyc.T.tolist(), strict=True))}]
        for xyc in p
    ]
    fractions = p / [*SIZE, 1.0]
    labels: Files = {
        f"walk_{t + 1}.txt": f"0 0.5 0.5 0.2 0.7 {' '.join(f'{v:.6g}' for v in xyc.ravel())} 0.9 3\n".encode()
        for t, xyc in enumerate(fractions)
    }
    contents = [frames, [json.dumps(frame) for frame in frames], frames[0]]
    return {
        "ultralytics": [{"yolo.json": _json(content)} for content in contents],
        "ultralytics labels": [labels],
    }


def _deeplabcut(p: np.ndarray, who: Sequence[str]) -> bytes:
    """A csv of DeepLabCut's, of the same points (T, 17, 3) for everybody."""
    parts = ["snout", *map(str, FORMATS["coco17"][1:])]
    columns = [(animal, part, kind) for animal in who for part in parts for kind in ("x", "y", "likelihood")]
    heads = [["scorer", *["DLC"] * len(columns)], ["individuals", *(animal for animal, _, _ in columns)]]
    heads += [["bodyparts", *(part for _, part, _ in columns)], ["coords", *(kind for _, _, kind in columns)]]
    rows = [[str(t), *(f"{v:g}" for _ in who for v in xyc.ravel())] for t, xyc in enumerate(p)]
    lines = [*(heads if len(who) > 1 else [heads[0], *heads[2:]]), *rows]
    return "\n".join(map(",".join, lines)).encode()


def _hdf5(p: np.ndarray) -> list[bytes]:
    """DeepLabCut's and SLEAP's files of points (T, 17, 3), of one person and of two."""
    parts = ["snout", *map(str, FORMATS["coco17"][1:])]
    kinds, frames = ("x", "y", "likelihood"), range(len(p))
    alone = [("DLC", part, kind) for part in parts for kind in kinds]
    both = [("DLC", who, part, kind) for who in ("ann", "bob") for part in parts for kind in kinds]
    flat = p.reshape(len(p), -1)
    two = np.concatenate([flat, flat + 1.0], axis=1)
    people = np.stack([p, p + 1.0], axis=1)
    return [
        deeplabcut_h5(alone, flat, [f"walk/img{t}.png" for t in frames]), deeplabcut_h5(both, two, frames),
        deeplabcut_fixed_h5(both, two, frames), sleap_h5(p[:, None], parts, ()), sleap_h5(people, parts, ("a", "b")),
        sleap_h5(people, parts, ("a", "b"), "standard", declared=True),
    ]  # fmt: skip


def _laboratory() -> dict[str, list[Files]]:
    """Markers of which some are joint centres, as capture systems write them."""
    names = ("RHJC", "L_HJC_reg", "r_knee", "r_mknee", "C7", "L_ankle")
    where = np.random.default_rng(3).uniform(0.1, 1.6, (FRAMES, len(names), 3))
    where[1, 2] = np.nan
    whole, floats = (c3d_file(names, 1e3 * where, whole=whole, up=up) for whole, up in ((True, "+Y"), (False, "")))
    with tempfile.TemporaryDirectory(prefix="kinemode-fuzz-") as folder:
        write_trc(Path(folder) / "a.trc", names, where, np.arange(FRAMES) / 100.0)
        text = (Path(folder) / "a.trc").read_bytes()
        np.savez(Path(folder) / "a.npz", points=where, names=np.array(names), fps=100.0, unit="m", up="z")
        arrays = (Path(folder) / "a.npz").read_bytes()
        np.save(Path(folder) / "a.npy", np.random.default_rng(4).uniform(0.1, 1.6, (FRAMES, 33, 3)))
        body = (Path(folder) / "a.npy").read_bytes()
        np.save(Path(folder) / "b.npy", where)
        named = {"a.npy": (Path(folder) / "b.npy").read_bytes(), "a.names.json": _json(names)}
    head = ",".join(["time", *(f"{name}_{axis}_mm" for name in names for axis in "xyz")])
    rows = [",".join([f"{t / 100.0}", *(f"{1e3 * v:.2f}" for v in row.ravel())]) for t, row in enumerate(where)]
    table = "\n".join(["# up=z", head, *rows]).replace("nan", "").encode()
    commas = text.replace(b"\t", b",").replace(b"mm", b"Millimetres")
    return {
        "c3d": [{"a.c3d": whole}, {"a.c3d": floats}], "trc": [{"a.trc": text}, {"a.trc": commas}],
        "points npz": [{"a.npz": arrays}], "points npy": [{"a.npy": body}, named], "points csv": [{"a.csv": table}],
    }  # fmt: skip


@contextmanager
def _stopping(label: str) -> Iterator[Progress]:
    """A progress report that is interrupted, as by Ctrl-C, before the last frame."""

    def stop(done: int, total: int) -> None:
        if label == "tracking" and done == total - 1:
            raise KeyboardInterrupt

    yield stop


def facing(name: str) -> Camera:
    """A camera 3 m in front of the origin."""
    return replace(guessed_camera(name, SIZE), t_camera_world=np.array([0.0, 0.0, 3.0]))


def cameras() -> list[Camera]:
    """Two that see the same place."""
    camera = guessed_camera("cam01", SIZE)
    turned = camera.R_camera_world @ np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return [
        camera,
        Camera("cam02", SIZE, camera.K, np.array([-0.1, 0.05, 0.0, 0.0, 0.01]), turned, np.array([0.1, 0, 4.0])),
    ]


def _texts() -> dict[str, list[Files]]:
    entries = [
        {"name": c.name, "image_size": list(SIZE), "K": c.K.tolist(), "distortion": c.distortion.tolist(),
         "R": c.R_camera_world.tolist(), "t": c.t_camera_world.tolist()}
        for c in cameras()
    ]  # fmt: skip
    alone = {key: entries[0][key] for key in ("name", "image_size", "K")}
    lines = [line for line in describe_settings("css").splitlines() if not line.startswith("#")]
    bare, some = "\n".join(lines), "\n".join(lines[:40])
    time = np.arange(FRAMES) / 30.0
    where = np.random.default_rng(1).normal(size=(FRAMES, 4, 3))
    arrays = {"points": where, "names": np.array(["nose", "left_hip", "right_hip", "neck"]), "fps": np.array(30.0)}
    ours = {"landmarks": where, "landmark_names": arrays["names"], "time": time}
    return {
        "camera text": _camera_texts(),
        "cameras": [{"cameras.json": _json({"cameras": some})} for some in (entries, [alone])],
        "bvh": [{"motion.bvh": text.encode()} for text in (BVH_PLAIN, BVH_CMU)],
        "settings": [{"settings.toml": text.encode()} for text in (bare, some, describe_settings("css-paper"))],
        "reference": [{"reference.npz": npz(arrays)}, {"reference.npz": npz(ours)}],
    }


def _camera_texts() -> list[Files]:
    """Camera files of other tools, none with more than one file."""
    lists = "size = [64.0, 48.0]\nmatrix = [[80.0, 0.0, 31.5], [0.0, 80.0, 23.5], [0.0, 0.0, 1.0]]\n"
    placed = "distortions = [0.1, -0.1, 0.0, 0.0]\nrotation = [1.2, 0.1, -0.1]\ntranslation = [0.{}, 0.2, 3.0]\n"
    toml = "".join(f"[cam_{i}]\nname = 'c{i}'\n{lists}{placed.format(i)}fisheye = false\n\n" for i in range(2))
    yaml = (
        "%YAML:1.0\n---\nimage_width: 64\nimage_height: 48\ncamera_matrix: !!opencv-matrix\n"
        "   rows: 3\n   cols: 3\n   dt: d\n   data: [ 80., 0., 31.5, 0., 80., 23.5, 0., 0., 1. ]\n"
        "distortion_coefficients: !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n"
        "   data: [ 0.1, -0.1, 0., 0., 0. ]\n"
    )
    qualisys = (
        '<calibration><cameras><camera active="1" serial="c1" model="none" viewrotation="0">'
        '<fov_video left="0" top="0" right="63" bottom="47"/><transform x="100" y="200" z="3000" r11="1" r12="0"'
        ' r13="0" r21="0" r22="0" r23="1" r31="0" r32="-1" r33="0"/><intrinsic focalLengthU="5120" focalLengthV="5120"'
        ' centerPointU="2016" centerPointV="1504" skew="0" sensorMaxU="4095" sensorMaxV="3071"'
        ' radialDistortion1="0.1"/>'
        "</camera></cameras></calibration>"
    )
    kalibr = "".join(
        f"cam{i}:\n  camera_model: pinhole\n  intrinsics: [80., 80., 31.5, 23.5]\n  resolution: [64, 48]\n"
        f"  distortion_model: radtan\n  distortion_coeffs: [0.1, -0.1, 0., 0.]\n{placed}"
        for i, placed in enumerate(("", "  T_cn_cnm1: [[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n"))
    )
    matrix = "!!opencv-matrix\n   rows: 3\n   cols: {}\n   dt: d\n   data: [{}]\n"
    easymocap = (
        "%YAML:1.0\n---\nnames:\n   - '01'\nW_01: 64\nH_01: 48\nK_01: "
        + matrix.format(3, "80., 0., 31.5, 0., 80., 23.5, 0., 0., 1.")
        + f"R_01: {matrix.format(1, '0.1, 0.2, 0.3')}T_01: {matrix.format(1, '0., 0., 3.')}"
    )
    entry = {"name": "00_00", "type": "vga", "resolution": list(SIZE), "K": np.diag([80.0, 80.0, 1.0]).tolist()}
    entry |= {"distCoef": [0.1, 0, 0, 0, 0], "R": np.eye(3).tolist(), "t": [[0.0], [0.0], [300.0]]}
    caliscope = toml.replace("[cam_", "[cameras.").replace("fisheye = false", "ignore = false")
    texts = {
        "a.toml": toml, "a.yml": yaml, "a.qca.txt": qualisys, "b.yml": kalibr, "c.yml": easymocap, "b.toml": caliscope,
        "a.json": json.dumps({"cameras": [entry]}),
    }  # fmt: skip
    return [{name: text.encode()} for name, text in texts.items()]


def npz(arrays: Mapping[str, np.ndarray]) -> bytes:
    """The bytes of an .npz."""
    file = io.BytesIO()
    keywords: dict[str, Any] = dict(arrays)
    np.savez_compressed(file, **keywords)
    return file.getvalue()


def _subjects() -> dict[str, list[Files]]:
    built_in = [(URDF_FOLDER / f"{name}.urdf").read_bytes() for name in ("arm8", "upper13", "human34")]
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], dtype=np.float32)
    faces = corners[[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]].reshape(4, 9)
    records = [np.concatenate([np.zeros(3, np.float32), face]).tobytes() + b"\0\0" for face in faces]
    stl = bytes(80) + np.uint32(4).tobytes() + b"".join(records)
    shapes = (("arm.stl", stl), ("arm.obj", OBJ.encode()), ("arm.dae", DAE.encode()))
    return {
        "urdf": [{"arm.urdf": ARM.encode()}, *({"body.urdf": text} for text in built_in)],
        "limb file": [{"limbs.toml": LIMBS.encode()}],
        "landmark file": [{"arm.landmarks.toml": ARM_LANDMARKS.encode(), "arm.urdf": ARM_MESHES[""].encode()}],
        "mesh": [{name: data, "arm.urdf": ARM_MESHES[name].encode()} for name, data in shapes],
    }


def _limbs(folder: Path) -> dict[str, list[Files]]:
    """Files of limb potentials and limb likelihoods."""
    potentials = [{"potentials.json": data} for data in (two_limbs(), SHIPPED.read_bytes())]
    return {"potentials": list(potentials), "templates": [{"templates.npz": templates(folder, cameras())}]}


def _pictures(folder: Path) -> dict[str, list[Files]]:
    """Clips as a film and as a folder of pictures, and pictures of the empty scene."""
    rng = np.random.default_rng(2)
    scene = cv2.resize(rng.integers(0, 255, (6, 8, 3), dtype=np.uint8), SIZE, interpolation=cv2.INTER_LINEAR)
    frames = [np.roll(scene, t, axis=1) for t in range(FRAMES)]
    film = cv2.VideoWriter(str(folder / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, SIZE)
    for frame in frames:
        film.write(frame)
    film.release()

    def encoded(suffix: str) -> list[bytes]:
        return [cv2.imencode(suffix, frame)[1].tobytes() for frame in frames]

    folders = [{f"{t}{suffix}": data for t, data in enumerate(encoded(suffix))} for suffix in (".png", ".jpg", ".bmp")]
    return {
        "film": [{"clip.mp4": (folder / "clip.mp4").read_bytes()}],
        "pictures": list(folders),
        "background": [{"plate.png": encoded(".png")[0]}, {"plate.jpg": encoded(".jpg")[0]}],
    }


def _runs(folder: Path, subjects: Sequence[str]) -> dict[str, list[Files]]:
    """Tracked runs, and a reference that was exported from one."""
    runs: list[Files] = []
    unfinished: list[Files] = []
    seen: list[Files] = []
    tables: list[Files] = []
    arrays: list[Files] = []
    angles: list[Files] = []
    for name in subjects:
        keypoints = _seen(folder, name)
        seen.append({keypoints.name: keypoints.read_bytes()})
        how: dict[str, Any] = {"keypoints": keypoints, "cameras": {"k": facing("k")}, "settings": QUICK, "fit": "off"}
        run = km.track(name, None, **how, out=folder / f"{name}.run")
        with suppress(KeyboardInterrupt):
            km.track(name, None, **how, out=folder / "stopped.run", overwrite=True, progress=_stopping)
        unfinished.append({f"{name}.run": (folder / "stopped.run").read_bytes()})
        runs.append({f"{name}.run": run.file.read_bytes()})
        export(run, folder / "a.trc")
        tables.append({"motion.csv": export(run, folder / "a.csv").read_bytes()})
        angles.append({"reference.csv": export(run, folder / "a.csv", degrees=True).read_bytes()})
        angles.append({"reference.mot": export(run, folder / "a.mot").read_bytes()})
        arrays.append({"motion.npz": export(run, folder / "a.npz").read_bytes()})
    with suppress(KeyboardInterrupt):  # particles, and extra arrays of several axes
        km.track(name, None, **how | ANNEALED, out=folder / "stopped.run", overwrite=True, progress=_stopping)
    particles = {f"{name}.run": (folder / "stopped.run").read_bytes()}
    laboratory = _laboratory()
    trc: list[Files] = [{"reference.trc": (folder / "a.trc").read_bytes()}, *laboratory["trc"]]
    return {
        "run": [*runs, particles], "unfinished run": [*unfinished, particles], "seen": seen, "trc": trc,
        "motion csv": tables, "motion npz": arrays, "angles": angles,
        **{name: laboratory[name] for name in ("c3d", "points npz", "points npy", "points csv")},
    }  # fmt: skip


def _seen(folder: Path, name: str) -> Path:
    """Keypoints of a subject at rest."""
    body = Body(load_subject(name))
    pixels = np.repeat(facing("k").project(body.landmarks(body.at(body.clamp(body.neutral))))[None], FRAMES, axis=0)
    track_ = KeypointTrack("landmarks", body.landmark_names, pixels, np.ones(pixels.shape[:2]), SIZE, 30.0)
    write_keypoints(folder / f"{name}.json", track_)
    return folder / f"{name}.json"
