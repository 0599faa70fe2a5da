"""Expensive fixtures that are never changed, made once for all test processes of a session."""

from __future__ import annotations

import os
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import pytest

from humanoid.support.locks import locked

T = TypeVar("T")


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], T]) -> T:
    """The result of `make`, called with an empty folder by the first process of a session that requests this name.

    The others wait and read the result from a file, so it has to be picklable. An exception is not shared: each process
    then tries for itself.
    """
    own = factory.getbasetemp()
    session = own.parent if "PYTEST_XDIST_WORKER" in os.environ else own  # xdist gives each process a folder inside it
    kept = session / "made_once" / name
    kept.parent.mkdir(exist_ok=True)
    with locked(kept.with_name(f"{name}.lock")):
        answer = kept / "answer.pickle"
        if not answer.exists():
            shutil.rmtree(kept, ignore_errors=True)  # what another process could not make
            kept.mkdir()
            made = make(kept)
            with answer.with_suffix(".part").open("wb") as file:
                pickle.dump(made, file)
            answer.with_suffix(".part").rename(answer)
    with answer.open("rb") as file:
        return pickle.load(file)  # type: ignore[no-any-return]
