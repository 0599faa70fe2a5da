"""The moving body as a binary glTF 2.0 file (Khronos Group, registry.khronos.org/glTF/specs/2.0).

The node `kinemode world` turns our world (z up) into glTF's (y up); below it is a node for each link that something is
drawn of, named as the link, whose animated translation and rotation are the placement of the link's joint in kinemode's
world [m]. Its meshes are the body's flesh, or the visual shapes of its URDF. The motion is that of the best path;
where it has no pose the nodes go straight on to the next one.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import trimesh
from scipy.spatial.transform import Rotation
from trimesh.visual.material import PBRMaterial

from estimator.data.formats.opensim import R_OPENSIM_WORLD
from estimator.runs.run_reader import Run
from estimator.runs.trainer_motion import continuous_quaternions
from humanoid.kinematics.body import Body
from humanoid.support.errors import InputError
from viz.solids.body_solids import body_solids
from viz.solids.solid import DrawnMesh, merged

_WORLD, _GLTF = "kinemode world", "glTF world"
_FLOAT = 5126  # glTF's componentType of single precision


def write_glb(run: Run, path: Path) -> None:
    """Write the run's body and motion; raises InputError for a run without a pose."""
    known = np.flatnonzero(np.isfinite(run.q).all(axis=1))
    rising = known[np.diff(run.time[known], prepend=-np.inf) > 0.0]
    if not len(rising):
        raise InputError(run.file, "contains no tracked frames", remedy="track with --resume first")
    path.write_bytes(animated_glb(run.body, run.q[rising], run.time[rising] - run.time[rising[0]]))


def animated_glb(body: Body, q: np.ndarray, time: np.ndarray) -> bytes:
    """The file of a motion q (T, nq) at rising times (T,) [s] from 0 on."""
    names = link_names(body)
    solids = merged(body_solids(body))
    joints = sorted({solid.joint for solid in solids})
    placements = body.placed(q).placements[:, joints]
    R = placements[..., :9].reshape(len(q), len(joints), 3, 3).swapaxes(2, 3)
    scene = trimesh.Scene(base_frame=_GLTF)
    scene.graph.update(frame_from=_GLTF, frame_to=_WORLD, matrix=_matrix(R_OPENSIM_WORLD, np.zeros(3)))
    for k, joint in enumerate(joints):
        scene.graph.update(frame_from=_WORLD, frame_to=names[joint], matrix=_matrix(R[0, k], placements[0, k, 9:]))
    for number, solid in enumerate(solids):
        scene.add_geometry(
            _mesh(solid), node_name=f"{names[solid.joint]} mesh {number}", parent_node_name=names[solid.joint]
        )
    quaternions = [continuous_quaternions(Rotation.from_matrix(R[:, k]).as_quat()) for k in range(len(joints))]

    def animate(buffers: Any, tree: dict[str, Any]) -> None:
        _animate(buffers, tree, [names[joint] for joint in joints], time, placements[..., 9:], quaternions)

    content = trimesh.exchange.gltf.export_glb(scene, include_normals=True, buffer_postprocessor=animate)
    return bytes(content)


def _animate(
    buffers: Any,
    tree: dict[str, Any],
    names: list[str],
    time: np.ndarray,
    translations: np.ndarray,
    quaternions: list[np.ndarray],
) -> None:
    """Add the animation to trimesh's parts of the file: what it writes has none."""
    node = {entry["name"]: i for i, entry in enumerate(tree["nodes"])}
    times = _accessor(buffers, tree, "time", time, "SCALAR")
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    for k, name in enumerate(names):
        entry = tree["nodes"][node[name]]
        entry.pop("matrix", None)  # an animated node has no matrix
        entry["translation"], entry["rotation"] = translations[0, k].tolist(), quaternions[k][0].tolist()
        for what, values, kind in (("translation", translations[:, k], "VEC3"), ("rotation", quaternions[k], "VEC4")):
            output = _accessor(buffers, tree, f"{name} {what}", values, kind)
            samplers.append({"input": times, "output": output, "interpolation": "LINEAR"})
            channels.append({"sampler": len(samplers) - 1, "target": {"node": node[name], "path": what}})
    tree["animations"] = [{"name": "motion", "samplers": samplers, "channels": channels}]


def _accessor(buffers: Any, tree: dict[str, Any], name: str, values: np.ndarray, kind: str) -> int:
    """Number of a new accessor with values (T,) or (T, D)."""
    single = np.ascontiguousarray(values, dtype="<f4")
    key = f"animation {name}"
    buffers[key] = single.tobytes()
    entry: dict[str, Any] = {
        "bufferView": len(buffers) - 1, "componentType": _FLOAT, "type": kind, "count": len(single),
    }  # fmt: skip
    if kind == "SCALAR":  # which is required for times
        entry |= {"min": [float(single.min())], "max": [float(single.max())]}
    tree["accessors"][key] = entry
    return len(tree["accessors"]) - 1


def _mesh(solid: DrawnMesh) -> trimesh.Trimesh:
    material = PBRMaterial(
        baseColorFactor=[*solid.paint, 255], metallicFactor=0.0, roughnessFactor=0.7, doubleSided=not solid.closed
    )
    visual = trimesh.visual.TextureVisuals(material=material)
    return trimesh.Trimesh(
        solid.vertices, solid.faces, vertex_normals=solid.shading(), visual=visual, process=False, validate=False
    )


def _matrix(R: np.ndarray, t: np.ndarray) -> np.ndarray:
    """A homogeneous transform (4, 4)."""
    T: np.ndarray = np.eye(4)
    T[:3, :3], T[:3, 3] = R, t
    return T


def link_names(body: Body) -> tuple[str, ...]:
    """A name for each joint (njoints), no two alike: of the first link that it moves, else its own; joint 0 stands for
    everything fixed to the world."""
    links: dict[int, str] = {}
    for frame in body.model.frames:
        if frame.type == pin.FrameType.BODY and frame.name != "universe":
            links.setdefault(int(frame.parentJoint), frame.name)
    taken = set(links.values())
    own = (f"joint {name}" if name in taken else str(name) for name in body.model.names)
    return tuple(links.get(j, name) for j, name in enumerate(own))
