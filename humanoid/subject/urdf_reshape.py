"""Flesh given other parameters, and which of its parts mirror each other."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from humanoid.subject import superquadric
from humanoid.subject.urdf_document import Document, elements
from humanoid.subject.urdf_flesh import read_flesh, write_flesh
from humanoid.support.errors import InputError
from humanoid.support.near_names import nearest


def reshape(document: Document, shapes: Mapping[int | str, Sequence[float]]) -> None:
    """Give parts other parameters, in place; they become superquadrics.

    shapes: nine parameters (`humanoid.subject.superquadric`) by the part's place among the document's parts, or by its
    link, which then has to have one part.

    Raises
    ------
    InputError: there is no such part, or its parameters are not a surface.
    """
    links = [link for link in elements(document.root, "link") for _ in elements(link, "flesh")]
    parts = [e for link in elements(document.root, "link") for e in elements(link, "flesh")]
    names = [link.get("name", "") for link in links]
    for key, values in shapes.items():
        k = _part_index(document.source, names, key)
        parameters = np.asarray(values, dtype=float)
        fault = superquadric.fault(parameters)
        if fault is not None:
            raise InputError(document.source, fault[0], place=f"shape of {key!r}", remedy=fault[1])
        flesh = read_flesh(document, names[k], parts[k]).with_parameters(parameters)
        write_flesh(parts[k], replace(flesh, shape="superquadric"))


def _part_index(source: str, names: Sequence[str], key: int | str) -> int:
    if isinstance(key, str):
        count = names.count(key)
        if count == 1:
            return names.index(key)
        problem = f"link {key!r} has {count} parts" if count else f"link {key!r} has no flesh"
        places = ", ".join(str(k) for k, name in enumerate(names) if name == key)
        remedy = f"name the part by its number, one of {places}" if count else nearest(key, names, "links")
        raise InputError(source, problem, place="shapes", remedy=remedy)
    if not 0 <= key < len(names):
        raise InputError(source, f"there is no part {key}", place="shapes", remedy=f"0 to {len(names) - 1}")
    return int(key)


def mirror_parts(links: Sequence[str]) -> np.ndarray:
    """The part that mirrors each part, (B,) int, itself without one.

    links (B): the links of the parts. Two parts mirror each other if their links' names differ in left and right, and
    if they come equally far among the parts of their links. `superquadric.MIRROR` turns the parameters of the one into
    those of the other.
    """
    known = {(link, list(links[:k]).count(link)): k for k, link in enumerate(links)}
    swap = {"left": "right", "right": "left"}
    other = [re.sub("left|right", lambda m: swap[m.group()], link) for link in links]
    return np.array([known.get((other[k], order), k) for (_, order), k in known.items()], dtype=np.int64)
