"""Limbs by what all views show of them: multi-view eigen-templates (Sigal et al., CVPR 2004, section 5), and their
file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.data.formats.checked_arrays import DamageError, Field, check_arrays
from estimator.data.formats.checked_json import mapping
from estimator.data.formats.npz import read_headed, write_headed
from estimator.data.observation import Observation
from estimator.trackers.loose_limbed.part_detectors.contract import AllPartProposals, PartProposals
from estimator.vision.eigen_templates import EigenSpace
from estimator.vision.patches import CHANNELS, PatchView, patch_view, patches_at, ray_places
from humanoid.limbs.limb import LimbGraph
from humanoid.support.errors import InputError
from humanoid.support.settings import CheckedSettings, setting

REMEDY = "train them for it: kinemode train-templates CAMERAS --out FILE"
_MOVED, _TURNED = 0.05, np.radians(2.0)  # by which a camera may stand elsewhere [m] and look elsewhere


@dataclass(frozen=True)
class TemplateSettings(CheckedSettings):
    """Settings of the search of limbs by templates.

    score: the score that ranks a place. "ratio" is the density of the limb's eigenspace over that of the eigenspace of
    other places of the person; "residual" the distance from the limb's eigenspace alone, to which the inside of a trunk
    is a good limb. places: best ones that are kept of a limb, at least `apart` [m] from each other. nearest: training
    examples of each place, whose orientations are taken. spacing [m]: of the places tried, larger where they would be
    more than `most`.
    Raises InputError where a value is outside its range.
    """

    score: str = setting("ratio", one_of=("ratio", "residual"))
    places: int = setting(10, at_least=1)
    nearest: int = setting(5, at_least=1)
    apart: float = setting(0.08, at_least=0)
    spacing: float = setting(0.035, at_least=0.01, at_most=0.5)
    most: int = setting(4000, at_least=100)


@dataclass(frozen=True, eq=False)
class LimbTemplate:
    """Appearance of a limb, or that of the other side of the body, around its middle in all cameras of a rig.

    limbs: their names. metres: side of a patch. space: of its patches. elsewhere: of patches at other places of the
    person. deviation [nats, or squared distance]: of the scores of its own patches, by ratio and by residual, (2,).
    coefficients (N, K): of the training patches. offset (N, 3) [m]: from each one's middle to the limb's proximal
    joint, in the world. quaternion (N, 4), x, y, z, w: the limb's orientation in the world.
    """

    limbs: tuple[str, ...]
    metres: float
    space: EigenSpace
    elsewhere: EigenSpace
    deviation: np.ndarray
    coefficients: np.ndarray
    offset: np.ndarray
    quaternion: np.ndarray

    def score(self, patches: np.ndarray, by: str) -> np.ndarray:
        """Similarity (N,) of patches (N, D) to the limb, by "ratio" or "residual"; more is better."""
        if by == "residual":
            return -self.space.residual(patches)
        return self.space.log_density(patches) - self.elsewhere.log_density(patches)

    def nearest(self, patches: np.ndarray, count: int) -> np.ndarray:
        """The training examples whose coefficients are nearest to those of patches (N, D): (N, count)."""
        given = self.space.coefficients(patches)
        square = (self.coefficients**2).sum(axis=1) - 2.0 * given @ self.coefficients.T
        return np.argsort(square, axis=1, kind="stable")[:, :count]


@dataclass(frozen=True, eq=False)
class LimbTemplates:
    """Templates of some limbs of a body for a rig of cameras C.

    names: the cameras'. centre (C, 3) [m], R_camera_world (C, 3, 3): where they stand. box (2, 3) [m]: where limbs can
    be. side, contrast: of the patches (`estimator.vision.patches.patches_at`). templates: one a pair of limbs.
    """

    names: tuple[str, ...]
    centre: np.ndarray
    R_camera_world: np.ndarray
    box: np.ndarray
    side: int
    contrast: float
    templates: tuple[LimbTemplate, ...]

    def check_rig(self, cameras: Sequence[Camera], source: str = "templates") -> None:
        """Raise InputError unless the cameras stand, in this order, where those do that the templates were trained
        for; pictures may have another size, and be undistorted."""
        if len(cameras) != len(self.names):
            problem = f"are of a rig of {len(self.names)} cameras, there are {len(cameras)}"
            raise InputError(source, problem, remedy=REMEDY)
        for k, camera in enumerate(cameras):
            away = float(np.linalg.norm(camera.centre_world - self.centre[k]))
            cosine = 0.5 * (float(np.sum(camera.R_camera_world * self.R_camera_world[k])) - 1.0)
            turned = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
            if not (away <= _MOVED and turned <= _TURNED):
                problem = (
                    f"are of another rig: {camera.name} is {away:.2f} m and {np.degrees(turned):.0f} degrees from where"
                    f" {self.names[k]} was"
                )
                raise InputError(source, problem, remedy=REMEDY)

    def check_graph(self, graph: LimbGraph, source: str = "templates") -> None:
        """Raise InputError where a limb of the templates is not in the graph."""
        missing = [name for template in self.templates for name in template.limbs if name not in graph.names]
        if missing:
            problem = f"are of another graph: it has no {missing[0]}, its limbs are {', '.join(graph.names[:6])}, ..."
            raise InputError(source, problem, remedy=REMEDY)


def observed_views(observation: Observation) -> tuple[PatchView, ...]:
    """The views of an instant as templates take them; none where a camera has no picture, or no silhouette."""
    views = []
    for cues in observation.cues:
        if cues.picture is None or "silhouette" not in cues:
            return ()
        views.append(patch_view(cues.camera, cues.picture, cues["silhouette"].mask))
    return tuple(views)


def template_proposals(
    templates: LimbTemplates,
    graph: LimbGraph,
    views: Sequence[PatchView],
    settings: TemplateSettings | None = None,
    limbs: Sequence[str] | None = None,
) -> AllPartProposals:
    """Proposed places of the limbs of a graph that have templates; none for others.

    A limb and that of the other side have one template, and the same proposals: patches do not distinguish them. Each
    of the best places has the offsets and orientations of the most similar training examples, all with a weight that
    falls by a factor e with each standard deviation of the scores of the limb's own patches.

    views: of one instant, in the order of the cameras (`observed_views`, `patch_view`). limbs: names of those to
    search, by default all that have templates.

    Raises
    ------
    InputError: the views are of another rig, or the templates of another graph.
    """
    settings = settings or TemplateSettings()
    templates.check_rig([view.camera for view in views])
    templates.check_graph(graph)
    nothing = PartProposals(np.zeros((0, 7)), np.zeros(0))
    part_proposals = dict.fromkeys(graph.names, nothing)
    places = _places(views, templates.box, settings)
    for template in templates.templates if len(places) else ():
        wanted = [name for name in template.limbs if limbs is None or name in limbs]
        if wanted:
            patches = patches_at(views, places, template.metres, templates.side, templates.contrast)
            part_proposals.update(dict.fromkeys(wanted, _proposals(template, places, patches, settings)))
    return tuple(part_proposals[name] for name in graph.names)


def _places(views: Sequence[PatchView], box: np.ndarray, settings: TemplateSettings) -> np.ndarray:
    """Places (N, 3) in the common foreground, wider apart where it is large."""
    spacing = settings.spacing
    places = ray_places(views, box, spacing)
    while len(places) > settings.most:
        spacing *= max(1.1, (len(places) / settings.most) ** (1.0 / 3.0))
        places = ray_places(views, box, spacing)
    return places


def _proposals(
    template: LimbTemplate, places: np.ndarray, patches: np.ndarray, settings: TemplateSettings
) -> PartProposals:
    """Proposals at places (N, 3) with their patches (N, D)."""
    score = template.score(patches, settings.score)
    best = best_apart(places, score, settings.places, settings.apart)
    like = template.nearest(patches[best], settings.nearest)
    t = (places[best][:, None] + template.offset[like]).reshape(-1, 3)
    points = np.concatenate([t, template.quaternion[like].reshape(-1, 4)], axis=1)
    deviation = float(template.deviation[int(settings.score == "residual")])
    weight = np.exp(np.maximum((score[best] - score[best[0]]) / deviation, -30.0))
    return PartProposals(points, np.repeat(weight / like.shape[1], like.shape[1]))


def best_apart(places: np.ndarray, score: np.ndarray, count: int, apart: float) -> np.ndarray:
    """Indices of the best of places (N, 3), best first, each at least `apart` from better ones; `count` at most."""
    left = np.argsort(-score, kind="stable")
    chosen: list[int] = []
    while len(left) and len(chosen) < count:
        chosen.append(int(left[0]))
        far = np.linalg.norm(places[left] - places[left[0]], axis=1) >= apart
        far[0] = False
        left = left[far]
    return np.array(chosen, dtype=int)


FORMAT = 1  # another whenever equal pictures give other patches
_SPACES = "space", "elsewhere"
_RIG = {"centre": Field("f", ("C", "3")), "R_camera_world": Field("f", ("C", "3", "3")), "box": Field("f", ("2", "3"))}
_OWN = {
    "coefficients": Field("f", ("N", "K")), "offset": Field("f", ("N", "3")), "quaternion": Field("f", ("N", "4")),
    "deviation": Field("f", ("2",)),
}  # fmt: skip
_OF_SPACE = {"mean": Field("f", ("D",)), "basis": Field("f", ("K", "D")), "variance": Field("f", ("K",))}


def save_templates(templates: LimbTemplates, path: str | Path) -> None:
    """Write them to one .npz file; raises InputError where it is not writable."""
    header: dict[str, Any] = {"format": FORMAT, "cameras": templates.names, "side": templates.side}
    header |= {"contrast": templates.contrast, "templates": []}
    arrays = {name: np.asarray(getattr(templates, name), float) for name in _RIG}
    for k, template in enumerate(templates.templates):
        rests = {name: getattr(template, name).rest for name in _SPACES}
        header["templates"].append({"limbs": template.limbs, "metres": template.metres, "rest": rests})
        for name in _OWN:
            arrays[f"{name}_{k}"] = np.asarray(getattr(template, name), np.float32)
        for space in _SPACES:
            for name in _OF_SPACE:
                arrays[f"{space}_{name}_{k}"] = np.asarray(getattr(getattr(template, space), name), np.float32)
    write_headed(Path(path), header, arrays)


def load_templates(path: str | Path) -> LimbTemplates:
    """Read templates; `LimbTemplates.check_rig` and `check_graph` check whether they suit cameras and a body.

    Raises
    ------
    InputError: the file cannot be read, is damaged, has no templates or those of another version.
    """
    path = Path(path)
    arrays, header = read_headed(path, "a file of limb templates", FORMAT, _RIG, REMEDY)
    try:
        return _read(arrays, header)
    except (DamageError, TypeError, ValueError, KeyError, AttributeError, OverflowError) as error:
        raise InputError(path, f"is damaged: {error}", remedy=REMEDY) from None


def _read(arrays: Mapping[str, np.ndarray], header: Mapping[str, Any]) -> LimbTemplates:
    names = tuple(str(name) for name in header["cameras"])
    fixed = {"2": 2, "3": 3, "4": 4}
    check_arrays(arrays, _RIG, {**fixed, "C": len(names)})
    side, contrast = int(header["side"]), float(header["contrast"])
    R, box = arrays["R_camera_world"], arrays["box"]
    if not names or not np.allclose(R @ R.transpose(0, 2, 1), np.eye(3), atol=1e-6) or not (box[0] < box[1]).all():
        raise DamageError("the rig has no cameras, invalid axes, or an empty box")
    if not 1 <= side <= 100 or not 0.0 <= contrast < 100.0:
        raise DamageError(f"patches of {side} samples, contrast {contrast:g}")
    depth = len(names) * CHANNELS * side**2
    made = tuple(_template(arrays, mapping(entry, "", ""), k, depth) for k, entry in enumerate(header["templates"]))
    limbs = [name for template in made for name in template.limbs]
    if not limbs or len(set(limbs)) < len(limbs):
        raise DamageError("limbs are missing, or have two templates")
    return LimbTemplates(names, arrays["centre"], R, box, side, contrast, made)


def _template(arrays: Mapping[str, np.ndarray], entry: Mapping[str, Any], k: int, depth: int) -> LimbTemplate:
    """Number k, of patches of `depth` numbers; raises DamageError."""
    spaces = {}
    for space in _SPACES:
        of = {name: arrays[f"{space}_{name}_{k}"] for name in _OF_SPACE}
        count = len(of["variance"])
        check_arrays(of, _OF_SPACE, {"D": depth, "K": count})
        rest = float(entry["rest"][space])
        if not 0 < count < depth or not (of["variance"] > 0.0).all() or not 0.0 < rest < np.inf:
            raise DamageError(f"{space}_{k} has {count} components, or invalid variances")
        spaces[space] = EigenSpace(of["mean"], of["basis"], of["variance"], rest)
    own = {name: arrays[f"{name}_{k}"] for name in _OWN}
    sizes = {"2": 2, "3": 3, "4": 4, "N": len(own["offset"]), "K": len(spaces["space"].variance)}
    check_arrays(own, _OWN, sizes)
    metres, length = float(entry["metres"]), np.linalg.norm(own["quaternion"], axis=1)
    if not len(length) or not np.allclose(length, 1.0, atol=1e-3) or not (own["deviation"] > 0.0).all():
        raise DamageError(f"template {k} has no examples, or invalid orientations")
    if not 0.0 < metres < 100.0:
        raise DamageError(f"template {k} has patches of {metres:g} m")
    own["quaternion"] = own["quaternion"] / length[:, None]
    return LimbTemplate(
        tuple(map(str, entry["limbs"])), metres, spaces["space"], spaces["elsewhere"], own["deviation"],
        own["coefficients"], own["offset"], own["quaternion"],
    )  # fmt: skip
