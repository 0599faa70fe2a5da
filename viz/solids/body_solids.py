"""A subject's surface as triangle meshes on its joints, and its skeleton as line segments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from humanoid.kinematics.body import Body, PosedBody, points_in_world
from humanoid.shape.flesh import flesh_meshes, solid_mesh
from humanoid.subject.subject import Flesh
from viz.solids.solid import DrawnMesh, Side, side_of
from viz.solids.visual_solids import missing_meshes, visual_solids

_BALL = 0.03  # radius of the ball for a link of unknown shape [m]

# pairs of landmark names, COCO's where COCO has one
LIMBS: tuple[tuple[str, str], ...] = (
    ("head_top", "neck"),
    ("neck", "mid_hip"),
    *((f"{s}_{a}", f"{s}_{b}") for s in ("left", "right") for a, b in (("eye", "ear"), ("shoulder", "elbow"))),
    *((f"{s}_{a}", f"{s}_{b}") for s in ("left", "right") for a, b in (("elbow", "wrist"), ("hip", "knee"))),
    *((f"{s}_{a}", f"{s}_{b}") for s in ("left", "right") for a, b in (("knee", "ankle"), ("ankle", "big_toe"))),
    *(
        (a, f"{s}_{b}")
        for a, b in (("nose", "eye"), ("neck", "shoulder"), ("mid_hip", "hip"))
        for s in ("left", "right")
    ),
)
# what stands in for the trunk where the body has no neck or no middle of the hips
_TRUNK: tuple[tuple[str, str], ...] = (
    ("left_shoulder", "right_shoulder"),
    ("left_hip", "right_hip"),
    ("left_shoulder", "left_hip"),
    ("right_shoulder", "right_hip"),
)


@dataclass(frozen=True)
class BoneSegments:
    """Line segments between points fixed to joints.

    joint (P,), local (P, 3) [m]: the points. segments (S, 2): indices of their ends. sides (S): for the colours.
    """

    joint: np.ndarray
    local: np.ndarray
    segments: np.ndarray
    sides: tuple[Side, ...]

    def at(self, posed: PosedBody) -> np.ndarray:
        """The points in the world [m], (P, 3)."""
        return points_in_world(posed, self.joint, self.local)


def body_solids(body: Body, *, coarse: bool = False) -> tuple[DrawnMesh, ...]:
    """The body's surface: its flesh, else its visual or collision geometry, else its joint tree as thin capsules.

    coarse: fewer triangles, enough for a translucent hypothesis. Where meshes are missing, see `drawing_notes`.

    Raises
    ------
    InputError: a mesh cannot be read, or its coordinates are not finite; it names the file and the link.
    """
    if body.subject.flesh:
        around, along = (12, 6) if coarse else (20, 12)
        meshes = flesh_meshes(body, around, along)
        return tuple(DrawnMesh(m.link, m.joint, side_of(m.link), m.vertices, m.faces) for m in meshes)
    solids, bare = visual_solids(body, coarse=coarse)
    if not solids and not bare:
        return _tree_solids(body)
    return (*solids, *(solid for link in bare for solid in _stand_ins(body, link)))


def drawing_notes(body: Body) -> tuple[str, ...]:
    """Notes for the user on how the body is drawn, one sentence each."""
    missing = () if body.subject.flesh else missing_meshes(body)
    if not missing:
        return ()
    links = sorted({shape.link for shape in missing})
    named = ", ".join(links[:5]) + (f" and {len(links) - 5} more" if len(links) > 5 else "")
    return (f"drawn without their meshes, which are gone (the first is {missing[0].file}): {named}",)


def _stand_ins(body: Body, link: str) -> tuple[DrawnMesh, ...]:
    """Capsules from a link's joint to the next ones, or a small ball at the end of the tree."""
    frame = body.model.frames[body.model.getFrameId(link, pin.FrameType.BODY)]
    solids = tuple(solid for solid in _tree_solids(body) if solid.joint == frame.parentJoint)
    if solids:
        return solids
    vertices, faces = solid_mesh(Flesh(link, "capsule", (_BALL, 1e-3, 0.0), (0, 0, 0), (0, 0, 0)))
    placed = vertices @ frame.placement.rotation.T + frame.placement.translation
    return (DrawnMesh(link, int(frame.parentJoint), side_of(link), placed, faces),)


def _tree_solids(body: Body) -> tuple[DrawnMesh, ...]:
    """A thin capsule from every joint to each of its children."""
    model = body.model
    first = _first_joint(body)
    offsets = {j: np.array(model.jointPlacements[j].translation) for j in range(first, model.njoints)}
    reach = max((float(np.linalg.norm(offset)) for offset in offsets.values()), default=0.0)
    solids: list[DrawnMesh] = []
    for j, offset in offsets.items():
        length = float(np.linalg.norm(offset))
        if length > 0.05 * reach:
            R_joint_capsule = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), offset).toRotationMatrix()
            capsule = Flesh(model.names[j], "capsule", (min(0.04, 0.1 * reach), length, 0.0), (0, 0, 0), (0, 0, 0))
            vertices, faces = solid_mesh(capsule)
            name = model.names[j]
            solids.append(
                DrawnMesh(
                    name, int(model.parents[j]), side_of(name), vertices @ R_joint_capsule.T + offset / 2.0, faces
                )
            )
    return tuple(solids)


def _first_joint(body: Body) -> int:
    """The first joint whose placement is a length of the body rather than its place in the world."""
    return 2 if body.has_free_root else 1


def skeleton(body: Body) -> BoneSegments:
    """The body's skeleton: limbs between named landmarks where the names are known, else the joint tree."""
    segments, sides = limb_segments(body.landmark_names)
    if len(segments) < 6:
        return _joint_tree(body)
    return BoneSegments(body.landmark_joint, body.landmark_local, segments, sides)


def limb_segments(names: Sequence[str]) -> tuple[np.ndarray, tuple[Side, ...]]:
    """Limbs between points of these names: indices of their ends (S, 2), and sides (S)."""
    index = {name: i for i, name in enumerate(names)}
    pairs = [(a, b) for a, b in LIMBS if a in index and b in index]
    if not {"neck", "mid_hip"} <= index.keys():
        pairs += [(a, b) for a, b in _TRUNK if a in index and b in index]
    segments = np.array([(index[a], index[b]) for a, b in pairs], dtype=np.int64).reshape(-1, 2)
    return segments, tuple(_pair_side(a, b) for a, b in pairs)


def _pair_side(a: str, b: str) -> Side:
    sides = {side_of(a), side_of(b)} - {"trunk"}
    return next(iter(sides)) if len(sides) == 1 else "trunk"


def _joint_tree(body: Body) -> BoneSegments:
    model = body.model
    first = _first_joint(body)
    children = [j for j in range(first, model.njoints) if np.linalg.norm(model.jointPlacements[j].translation) > 1e-3]
    joints = [j for child in children for j in (model.parents[child], child)]
    local = np.zeros((len(joints), 3))
    return BoneSegments(
        np.array(joints, dtype=np.int64),
        local,
        np.arange(len(joints)).reshape(-1, 2),
        tuple(side_of(model.names[j]) for j in children),
    )
