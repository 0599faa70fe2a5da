"""Runs as recordings of rerun (rerun.io), to be opened with `rerun FILE`.

Timelines `time` [s] and `frame`. Entities, z up, metres:
world/body/LINK: the placement of the link's joint, its meshes below it. world/landmarks. world/hypotheses/K: the
skeletons of the other hypotheses, K their place in the frame. world/cameras/NAME: pinhole (without its distortion),
keypoints, and the film where it is an mp4 that is still there; of a parallel camera cameras/NAME, without a place in
the world. Of a run that was made from another motion, world/source: bones and head of what the body followed, moved
aside; world/source/standing and world/standing: places on the floor below what stands of it, and what is to of the
body; world/floor: its lines. angles/NAME, angles/NAME/std: joint angles [deg] or ways [m] of the best path, and the
calibrated standard deviation of all hypotheses together. status: of the frames, where it changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from colorsys import hsv_to_rgb
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from estimator.data.cameras.camera import Camera
from estimator.runs.coordinates import joint_entries
from estimator.runs.run_reader import Run
from humanoid.support.extras import optional
from viz import palette
from viz.gltf import link_names
from viz.scene import Scene, as_scene
from viz.solids.body_solids import body_solids, skeleton
from viz.solids.solid import merged, side_of
from viz.source_figure import HEAD_RADIUS

_MOST_FILM = 200_000_000  # bytes of a film that is put into the file
_CURVES = 6  # that are shown at first
_BONE, _STANDS = 0.014, 0.03  # radii of the source's bones, and of places where something stands [m]
_HALF = 0.5  # px: the middle of the first pixel lies at 0 here, at a half there


class Angle(NamedTuple):
    """A joint of one degree of freedom over time: values and std (T,), in `unit`."""

    name: str
    values: np.ndarray
    std: np.ndarray
    unit: str


def write_rrd(run: Run, path: Path) -> None:
    """Write a recording.

    Raises
    ------
    InputError: rerun is not installed, or the run contains no tracked frames.
    """
    rr = optional("rerun", "rerun", "rrd files")
    scene = as_scene(run)
    recording = rr.RecordingStream("kinemode", recording_id=f"kinemode {run.file.stem}", send_properties=False)
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    angles = list(angles_of(run))
    log = _Log(rr, recording, scene)
    recording.save(path, default_blueprint=log.layout(angles))
    log.world()
    log.body()
    log.landmarks(run.landmarks)
    log.hypotheses()
    log.source(run.landmarks)
    for c in range(len(scene.cameras)):
        log.camera(c, run.header.clips.get(scene.cameras[c].name))
    for k, angle in enumerate(angles):
        log.angle(angle, colour=_far_apart(k))
    log.status()
    recording.flush()
    recording.disconnect()


def angles_of(run: Run) -> Iterator[Angle]:
    """The joints that turn or slide, with their std."""
    index = {name: j for j, name in enumerate(run.body.model.names)}
    for entry in joint_entries(run.body):
        if entry.kind not in ("turn", "slide", "endless"):
            continue
        part = run.q[:, entry.start : entry.start + entry.count]
        unit, scale = ("m", 1.0) if entry.kind == "slide" else ("deg", 180.0 / np.pi)
        value = np.arctan2(part[:, 1], part[:, 0]) if entry.kind == "endless" else part[:, 0]
        std = run.std[:, run.body.model.idx_vs[index[entry.name]]]
        yield Angle(entry.name, scale * value, scale * std, unit)


def _far_apart(k: int) -> palette.Rgb:
    """The colour of curve k: hues by the golden section, so that no two near each other are alike."""
    red, green, blue = hsv_to_rgb((0.6180339887 * k) % 1.0, 0.65, 0.95)
    return round(255 * red), round(255 * green), round(255 * blue)


class _Log:
    """Writes the scene into the recording `to`; rr: the module."""

    def __init__(self, rr: Any, to: Any, scene: Scene) -> None:
        self._rr, self._to, self._scene = rr, to, scene
        self._known = np.array([scene.has_body(t) for t in range(len(scene))])

    def layout(self, angles: Sequence[Angle]) -> Any:
        """The initial layout: the world, the cameras' pictures, the angles that change most."""
        rrb = optional("rerun.blueprint", "rerun", "rrd files")
        cameras = [
            rrb.Spatial2DView(origin=self._camera_path(camera), name=camera.name) for camera in self._scene.cameras
        ]
        known = [angle for angle in angles if np.isfinite(angle.values).any() and angle.unit == "deg"]
        most = sorted(known, key=lambda angle: -float(np.nanmax(angle.values) - np.nanmin(angle.values)))[:_CURVES]
        curves = rrb.TimeSeriesView(
            origin="angles", name="angles that change most [deg]",
            contents=[f"+ /{self._path('angles', angle.name)}" for angle in most],
        )  # fmt: skip
        beside = [rrb.Tabs(*cameras), curves] if cameras else [curves]
        world = rrb.Spatial3DView(origin="world", name="world")
        return rrb.Blueprint(
            rrb.Horizontal(world, rrb.Vertical(*beside), column_shares=[3, 2]), collapse_panels=True
        )  # fmt: skip

    def world(self) -> None:
        """Which way is up."""
        self._to.log("world", self._rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def body(self) -> None:
        """Placements and meshes of the links."""
        rr, body = self._rr, self._scene.body
        names, solids = link_names(body), merged(body_solids(body))
        rows = np.flatnonzero(self._known)
        placed = body.placed(self._scene.q[rows])
        for joint in sorted({solid.joint for solid in solids}):
            turns = Rotation.from_matrix(placed.rotations_of(joint))
            columns = rr.Transform3D.columns(translation=placed.placements[:, joint, 9:], quaternion=turns.as_quat())
            self._columns(self._path("world", "body", names[joint]), rows, columns)
        for k, solid in enumerate(solids):
            mesh = rr.Mesh3D(
                vertex_positions=solid.vertices, triangle_indices=solid.faces, vertex_normals=solid.shading(),
                albedo_factor=[*solid.paint, 255],
            )  # fmt: skip
            self._to.log(self._path("world", "body", names[solid.joint], f"mesh{k}"), mesh, static=True)

    def landmarks(self, points: np.ndarray) -> None:
        """Points (T, L, 3) [m] in the colours of their sides."""
        rr, names = self._rr, self._scene.body.landmark_names
        rows = np.flatnonzero(self._known)
        if not names:
            return
        colours = [palette.SIDES[side_of(name)] for name in names]
        shared = rr.Points3D.from_fields(labels=list(names), colors=colours, radii=[0.012], show_labels=False)
        self._to.log("world/landmarks", shared, static=True)
        columns = rr.Points3D.columns(positions=points[rows].reshape(-1, 3)).partition([len(names)] * len(rows))
        self._columns("world/landmarks", rows, columns)

    def hypotheses(self) -> None:
        """The skeletons of other hypotheses, more transparent the smaller their weight."""
        rr, scene = self._rr, self._scene
        lines = skeleton(scene.body)
        shown: set[int] = set()
        for t in range(len(scene)):
            self._at(t)
            others = scene.others(t)
            for k, q, weight in others:
                strips = lines.at(scene.body.at(q))[lines.segments]
                colour = [*palette.HYPOTHESIS, round(60 + 195 * weight)]
                self._to.log(f"world/hypotheses/{k}", rr.LineStrips3D(strips, colors=[colour], radii=[0.006]))
            for gone in shown - {k for k, _, _ in others}:
                self._to.log(f"world/hypotheses/{gone}", rr.Clear(recursive=False))
            shown = {k for k, _, _ in others}

    def source(self, landmarks: np.ndarray) -> None:
        """The source that the body followed, and the standing points of both, of the body by its landmarks (T, L, 3)
        [m]."""
        rr, source, names = self._rr, self._scene.source, self._scene.body.landmark_names
        if source is None:
            return
        self._to.log(
            "world/floor", rr.LineStrips3D(source.floor_lines, colors=[palette.GRID], radii=[0.002]), static=True
        )
        colours = np.array([palette.SIDES[side] for side in source.sides])
        for t in range(len(self._scene)):
            self._at(t)
            bones = source.points[t][source.segments]
            there = np.isfinite(bones).all(axis=(1, 2))
            self._to.log("world/source", rr.LineStrips3D(bones[there], colors=colours[there], radii=[_BONE]))
            if source.head is not None:
                head = source.points[t, [source.head]]
                known = head[np.isfinite(head).all(axis=1)]
                self._to.log(
                    "world/source/head", rr.Points3D(known, colors=[palette.SIDES["trunk"]], radii=[HEAD_RADIUS])
                )
            self._standing("world/source/standing", source.standing_points(t, source.names, source.points[t]))
            self._standing("world/standing", source.standing_points(t, names, landmarks[t]))

    def _standing(self, path: str, points: np.ndarray) -> None:
        """Discs' middles on the floor below points (N, 3) [m]."""
        source = self._scene.source
        assert source is not None
        places = np.column_stack([points[:, :2], np.full(len(points), source.level)])
        self._to.log(path, self._rr.Points3D(places, colors=[palette.GOOD], radii=[_STANDS]))

    def camera(self, c: int, clip: str | None) -> None:
        """A camera, the keypoints in it, and its film."""
        rr, scene, camera = self._rr, self._scene, self._scene.cameras[c]
        path = self._camera_path(camera)
        if not camera.parallel:
            self._pinhole(path, camera)
        self._film(path, c, clip)
        names, points = np.array(scene.body.landmark_names), f"{path}/keypoints"
        for t in range(len(scene)):
            seen = scene.confidence[t, c] > 0.0
            self._at(t)
            colours = [[*palette.SIDES[side_of(str(name))], 255] for name in names[seen]]
            keypoints = rr.Points2D(
                scene.pixels[t, c, seen] + _HALF, labels=names[seen].tolist(), colors=colours, radii=[3.0],
                show_labels=False,
            )  # fmt: skip
            self._to.log(points, keypoints)

    def _camera_path(self, camera: Camera) -> str:
        """A camera's place in the file: rerun's cameras in the world are pinholes, so parallel ones are outside it."""
        return self._path(*([] if camera.parallel else ["world"]), "cameras", camera.name)

    def _pinhole(self, path: str, camera: Camera) -> None:
        rr = self._rr
        pose = rr.Transform3D(translation=camera.centre_world, mat3x3=camera.R_camera_world.T)
        K = camera.K + np.array([[0.0, 0.0, _HALF], [0.0, 0.0, _HALF], [0.0, 0.0, 0.0]])
        pinhole = rr.Pinhole(
            image_from_camera=K, resolution=camera.image_size, camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=0.4,
        )  # fmt: skip
        self._to.log(path, pose, pinhole, static=True)

    def _film(self, path: str, c: int, clip: str | None) -> None:
        rr, scene = self._rr, self._scene
        file = Path(clip or "")
        if file.suffix.lower() != ".mp4" or not file.is_file() or file.stat().st_size > _MOST_FILM:
            return
        film = rr.AssetVideo(path=file)
        try:
            stamps = film.read_frame_timestamps_nanos()
        except RuntimeError:  # a film that rerun does not play
            return
        rows = np.array([t for t in range(len(scene)) if scene.frame_of(c, t) < len(stamps)], dtype=np.int64)
        self._to.log(f"{path}/film", film, static=True)
        frames = stamps[[scene.frame_of(c, int(t)) for t in rows]]
        columns = rr.VideoFrameReference.columns(
            timestamp=[rr.components.VideoTimestamp(nanoseconds=n) for n in frames]
        )
        self._columns(f"{path}/film", rows, columns)

    def angle(self, angle: Angle, colour: palette.Rgb) -> None:
        """Value and std of a joint."""
        rr, path = self._rr, self._path("angles", angle.name)
        for name, values in ((path, angle.values), (f"{path}/std", angle.std)):
            rows = np.flatnonzero(np.isfinite(values))
            label = f"{angle.name}{' std' if name != path else ''} [{angle.unit}]"
            self._to.log(name, rr.SeriesLines(names=[label], colors=[colour]), static=True)
            self._columns(name, rows, rr.Scalars.columns(scalars=values[rows]))

    def status(self) -> None:
        """The frames' status as text, where it changes."""
        before = ""
        for t, status in enumerate(self._scene.status):
            if status != before:
                self._at(t)
                level = "INFO" if status == "tracked" else "WARN"
                self._to.log("status", self._rr.TextLog(status, level=level))
            before = status

    def _at(self, t: int) -> None:
        self._to.set_time("time", duration=float(self._scene.time[t]))
        self._to.set_time("frame", sequence=int(self._scene.index[t]))

    def _columns(self, path: str, rows: np.ndarray, columns: Any) -> None:
        """Values of an entity at instants `rows` (N,)."""
        rr, scene = self._rr, self._scene
        if not len(rows):
            return
        indexes = [
            rr.TimeColumn("time", duration=scene.time[rows]), rr.TimeColumn("frame", sequence=scene.index[rows])
        ]  # fmt: skip
        rr.send_columns(path, indexes=indexes, columns=columns, recording=self._to, strict=True)

    def _path(self, *parts: str) -> str:
        return "/".join(self._rr.escape_entity_path_part(part) for part in parts)
