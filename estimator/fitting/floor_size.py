"""How large a person is whom one camera sees stand on a floor of known height."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from estimator.data.observation import Observation
from estimator.energy.gravity_prior import world_up
from humanoid.collision.floor import FloorDistances
from humanoid.kinematics.body import Body

_SIZES, _NU = 0.06, 4.0  # of the logarithm of people's heights about the subject's, with tails, as there are children
_SOLE = 0.02  # m: of a sole above the floor, as shoes and the flesh have it
_LOWEST_CAMERA = 0.3  # m above the floor: a lower camera sees distances badly
_INDEPENDENT = 4.0  # frames at most that count as independent
_SMALLEST, _LARGEST = 0.4, 1.4  # sizes beyond which the floor or the unit is in doubt


class FloorSize(NamedTuple):
    """factor: by which the person is larger than modelled, and as much farther away, with what is known of people. std:
    its relative standard deviation. seen: the same factor by the floor alone. believed: whether people can be so."""

    factor: float
    std: float
    seen: float
    believed: bool


def size_by_floor(body: Body, poses: np.ndarray, observations: Sequence[Observation], floor: float) -> FloorSize | None:
    """By where the lowest parts of the poses (F, nq) are on their rays, and the floor's height in the world [m].

    A person k times as large and as far away looks the same to a pinhole; so a camera h above the floor sees somebody h
    over (h less the height of the soles above the floor) times as large as modelled. The median over the frames, which
    leaves out those in the air. None where the camera is parallel, or no more than 0.3 m above the floor, and of a body
    without a free root or flesh.
    """
    camera = observations[0].cameras[0]
    up = world_up(observations[0].cameras)
    drop = float(camera.origin_world @ up) - floor
    if camera.parallel or not body.has_free_root or drop < _LOWEST_CAMERA:
        return None
    lowest = FloorDistances(body, up, floor).lowest(body.placed(poses))
    sole = lowest[lowest < 0.9 * drop]
    if not len(sole):
        return None
    logs = np.log(drop / (drop - sole))
    seen = float(np.median(logs))
    scatter = 1.4826 * float(np.median(np.abs(logs - seen))) / np.sqrt(min(len(logs), _INDEPENDENT))
    variance = (_SOLE / drop) ** 2 + scatter**2 + camera.focal_std**2
    people = _SIZES**2 + seen**2 / _NU
    share = people / (people + variance)
    believed = bool(_SMALLEST < np.exp(seen) < _LARGEST)
    factor = float(np.exp(share * seen)) if believed else 1.0
    return FloorSize(factor, float(np.sqrt(share * variance)), float(np.exp(seen)), believed)
