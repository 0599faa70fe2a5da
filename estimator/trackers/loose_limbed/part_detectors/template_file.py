"""Templates of limbs for a rig as a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from estimator.data.formats.checked_arrays import DamageError, Field, check_arrays
from estimator.data.formats.checked_json import mapping
from estimator.data.formats.npz import read_headed, write_headed
from estimator.trackers.loose_limbed.part_detectors.templates import REMEDY, LimbTemplate, LimbTemplates
from estimator.vision.eigen_templates import EigenSpace
from estimator.vision.patches import CHANNELS
from humanoid.support.errors import InputError

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
    arrays, header = read_headed(path, "file of templates of limbs", FORMAT, _RIG, REMEDY)
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
