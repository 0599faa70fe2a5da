"""A run without `out` leaves nothing behind, and can be used until its last reference is gone."""

from __future__ import annotations

import copy
import gc
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinemode
from estimator.runs.run_reader import Run
from kinemode import jobs
from kinemode.demo import make_clip
from kinemode.progress import unreported
from kinemode.shot import RenderedClip

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> RenderedClip:
    return make_clip(tmp_path_factory.mktemp("clip"), frames=2, videos=False, progress=unreported)


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for temporary files."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def track(clip: RenderedClip) -> Run:
    how: dict[str, Any] = {"tracker": "single-mode", "fit": "off", "settings": {"smooth": {"enabled": False}}}
    return kinemode.track("human34", None, keypoints=next(iter(clip.keypoints.values())), cameras=clip.cameras, **how)


def left(folder: Path) -> list[Path]:
    gc.collect()
    return list(folder.iterdir())


def test_it_is_deleted_with_its_last_user(clip: RenderedClip, temporary: Path) -> None:
    run = track(clip)
    assert run.file.is_file()
    again = kinemode.open_run(run.file)
    time = run.time
    del run
    assert len(again.q) == len(time) == 2  # read from the file
    del again
    assert left(temporary) == []


@pytest.mark.parametrize("copied", [lambda run: pickle.loads(pickle.dumps(run)), copy.deepcopy])
def test_a_copy_has_its_own(clip: RenderedClip, temporary: Path, copied: Callable[[Run], Run]) -> None:
    run = track(clip)
    q, other = run.q, copied(kinemode.open_run(run.file))
    assert other.file != run.file
    del run
    gc.collect()
    np.testing.assert_array_equal(other.q, q)
    del other
    assert left(temporary) == []


def test_a_run_that_is_kept_is_not_copied(clip: RenderedClip, temporary: Path) -> None:
    run = track(clip)
    file = temporary / "a.run"
    file.write_bytes(run.file.read_bytes())
    other = pickle.loads(pickle.dumps(kinemode.open_run(file)))
    assert other.file == file
    del other, run
    assert left(temporary) == [file]


def test_a_failure_leaves_nothing(clip: RenderedClip, temporary: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(jobs, "run_into", broken)
    with pytest.raises(ZeroDivisionError):
        track(clip)
    assert left(temporary) == []


def test_it_is_deleted_with_the_process_but_not_with_a_fork(temporary: Path) -> None:
    code = """
import os, sys
from estimator.runs.run_store import TemporaryFolder
kept = TemporaryFolder()
child = os.fork()
if child == 0:
    sys.exit()
os.waitpid(child, 0)
print(kept.path.is_dir())
"""
    environment = {**os.environ, "TMPDIR": str(temporary), "PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
    assert list(temporary.iterdir()) == []
