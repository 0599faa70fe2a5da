"""How long chains of many joints take to load, in a process of their own each: the time must grow about linearly.

Loading is `load_subject`, `Body` and, where the links have shapes, `SelfCollision`.
"""

from __future__ import annotations

import resource
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

from humanoid.collision.self_collision import SelfCollision
from humanoid.kinematics.body import Body
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError

JOINTS = (50, 100, 200, 400, 1000, 1999)
TARGET = 400, 2.0  # joints, seconds
_LIMITS = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'
_SHAPE = '<collision><geometry><cylinder radius="0.01" length="0.04"/></geometry></collision>'
_MEGABYTE = 1e6 if sys.platform == "darwin" else 1e3  # getrusage's units in one


class Loaded(NamedTuple):
    """Seconds to load, seconds for kinematics of one pose, and the most memory of the process [MB]; what refused it."""

    seconds: float
    pose: float
    memory: float
    refused: str


def chain(joints: int, shapes: bool) -> str:
    """A URDF of so many revolute joints in a row, with a cylinder on every link or without."""
    links = "".join(f'<link name="l{k}">{_SHAPE if shapes else ""}</link>' for k in range(joints + 1))
    between = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="0 0 0.05"/><axis xyz="{k % 2} {1 - k % 2} 0"/>{_LIMITS}</joint>'
        for k in range(joints)
    )
    return f'<robot name="chain">{links}{between}</robot>'


def load(path: Path) -> Loaded:
    """Load one file; imports and compiled kernels are not counted."""
    load_subject("example-robot-data:panda")
    Body(load_subject("arm8")).at(Body(load_subject("arm8")).neutral)
    start = perf_counter()
    refused = ""
    body = Body(load_subject(path))
    try:
        SelfCollision(body)
    except InputError as error:
        refused = error.problem
    middle = perf_counter()
    body.at(body.neutral)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _MEGABYTE
    return Loaded(middle - start, perf_counter() - middle, memory, refused)


def main(joints: Sequence[int] = JOINTS) -> None:
    """Print the table."""
    print("joints  shapes  load [s]  per joint [ms]  one pose [ms]  memory [MB]")
    with tempfile.TemporaryDirectory() as folder:
        for shapes in (False, True):
            for count in joints:
                path = Path(folder) / f"chain{count}.urdf"
                path.write_text(chain(count, shapes))
                with ProcessPoolExecutor(1, get_context("spawn")) as pool:
                    loaded = pool.submit(load, path).result()
                each = f"{loaded.seconds:8.2f}  {1e3 * loaded.seconds / count:14.2f}  {1e3 * loaded.pose:13.2f}"
                print(f"{count:6d}  {'yes' if shapes else 'no':>6}  {each}  {loaded.memory:11.0f}  {loaded.refused}")
    print(f"target: {TARGET[0]} joints in under {TARGET[1]:g} s")
