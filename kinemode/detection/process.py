"""A detector's program, which runs while pictures are shown to it (`scripts/serving.py` is its side), and its
environment: made once in the user's cache, with packages that never meet ours.

The package uv, a dependency of ours, makes the environment: it reads what a program declares that it needs (PEP 723:
inline script metadata), finds or fetches a Python, and is installed with kinemode, so no second way by pip is needed.
"""

from __future__ import annotations

import hashlib
import json
import os
import queue
import re
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
from uv import find_uv_bin

from humanoid.support.compiled_cache import cache_roots
from humanoid.support.errors import InputError
from humanoid.support.locks import locked
from kinemode.detection.detectors import DetectorChoice, Patience
from kinemode.detection.people import Search, State
from kinemode.notices import warn
from kinemode.target import cache_folder

PATIENCE = Patience()


def python_for(detector: str, script: Path, given: Path | None = None, patience: Patience = PATIENCE) -> Path:
    """The Python that runs a detector's program: of the environment in the cache, which is made where it is not there.

    given: a Python to make it with; one that has the packages itself is used unchanged.

    Raises
    ------
    InputError: no Python that fits, or packages that cannot be had; with what to do about it.
    """
    base = None if given is None else shutil.which(given)
    if given is not None and base is None:
        raise InputError(given, "is not a Python", remedy=f"name the file of a CPython {_needs(script)[0]}")
    python = None if base is None else Path(base).absolute()
    if python is not None and _has_packages(python, script, patience.python):
        return python
    if (ready := made_python(detector, script)) is not None:
        return ready
    folder = cache_folder().absolute() / _name(detector, script)
    try:
        with locked(folder.with_suffix(".lock")):
            if made_python(detector, script) is None:  # another process may have made it meanwhile
                _make(folder, detector, script, python, patience.installation)
    except OSError as error:
        raise InputError(
            folder, f"cannot be made: {error.strerror or error}", remedy="KINEMODE_CACHE names another"
        ) from None
    return folder / "bin" / "python"


def made_python(detector: str, script: Path) -> Path | None:
    """The Python of a detector's environment; None where that is not there, or the Python that it was made with."""
    pythons = (root.absolute() / _name(detector, script) / "bin" / "python" for root in cache_roots())
    return next((python for python in pythons if os.access(python, os.X_OK)), None)


def alone(python: Path, *words: str) -> list[str]:
    """The command of a Python that uses no variables and no packages of the user, and writes nothing beside code."""
    return [str(python), "-E", "-s", "-B", *words]


def clean_environment() -> dict[str, str]:
    """The variables of this process without those that would lead another Python, or an installer, to our packages."""
    ours = ("VIRTUAL_ENV", "CONDA_PREFIX", "__PYVENV_LAUNCHER__")
    return {name: v for name, v in os.environ.items() if name not in ours and not name.startswith("PYTHON")}


def _needs(script: Path) -> tuple[str, str]:
    """The versions of Python that a program declares to run with, and a digest of this and of its packages."""
    header = script.read_text(encoding="utf-8").partition("# ///\n")[0]
    return re.findall(r'requires-python = "(.+)"', header)[0], hashlib.sha256(header.encode()).hexdigest()[:16]


def _name(detector: str, script: Path) -> str:
    """The name of an environment's folder: another one for other packages, the same for every checkout."""
    return f"detector-{detector}-{_needs(script)[1]}"


def _has_packages(python: Path, script: Path, seconds: float) -> bool:
    """Whether a Python has all that a program needs: nothing is missing where nothing can be had from anywhere."""
    nowhere = ("--dry-run", "--no-cache", "--no-config", "--no-index", "--offline", "--break-system-packages")
    try:
        _uv("pip", "install", *nowhere, *_packages(python, script), seconds=seconds)
    except subprocess.SubprocessError:
        return False
    return True


def _make(folder: Path, detector: str, script: Path, base: Path | None, seconds: float) -> None:
    """Make the environment, which gets its name when it is whole; what an interrupted attempt has left goes first."""
    needed = _needs(script)[0]
    note = f"{detector} gets an environment of its own, once: some 150 MB of packages into {folder}"
    warn(note)
    part = folder.with_suffix(".part")
    for old in (folder, part):
        shutil.rmtree(old, ignore_errors=True)
    own = f"--python PATH: a CPython {needed} that has the packages {script} lists"
    remedy = f"it needs a network connection the first time; or {own}"
    try:
        _uv("venv", "--no-project", "--python", str(base or needed), str(part), seconds=seconds)
        _uv("pip", "install", *_packages(part, script), seconds=seconds)
    except subprocess.TimeoutExpired:
        raise InputError(detector, f"was not installed within {seconds / 60:.0f} minutes", remedy=remedy) from None
    except subprocess.CalledProcessError as error:
        raise InputError(detector, f"cannot be installed: {_last_error(error)}", remedy=remedy) from None
    part.rename(folder)


def _packages(python: Path, script: Path) -> list[str]:
    """The arguments for the packages that a program lists, in a Python or its environment: these and no others."""
    return ["--no-deps", "--python", str(python), "--requirements", str(script)]


def _uv(*words: str, seconds: float) -> None:
    """Run uv, far from settings of a project; raises SubprocessError where it fails or takes longer."""
    subprocess.run(
        [find_uv_bin(), "--quiet", *words],
        check=True, capture_output=True, text=True, timeout=seconds, env=clean_environment(), cwd=os.sep,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip


def _last_error(error: subprocess.CalledProcessError) -> str:
    lines = [line.strip() for line in f"{error.stdout}\n{error.stderr}".splitlines() if line.strip()]
    reasons = [line for line in lines if line.lower().startswith(("error", "cause"))] or lines
    return reasons[-1] if reasons else f"uv ended with {error.returncode}"


class DetectorProcess:
    """A running detector; a context manager, which ends it.

    layout: of its keypoints, None where only their count is known. names (K): of its keypoints, or None.
    """

    def __init__(self, wanted: DetectorChoice) -> None:
        self._name, self._patience = wanted.name, wanted.patience
        self._said = tempfile.TemporaryFile()  # noqa: SIM115, closed by `close`
        python = python_for(wanted.name, wanted.script, wanted.python, self._patience)
        # in a session of its own Ctrl-C does not reach it: it ends when we do, with its standard input
        self._child = subprocess.Popen(
            alone(python, str(wanted.script), json.dumps(wanted.options)),
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._said,
            env=clean_environment() | {"GLOG_minloglevel": "2", "TF_CPP_MIN_LOG_LEVEL": "2"}, cwd=os.sep,
            start_new_session=True,
        )  # fmt: skip
        self._lines: queue.Queue[bytes] = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()
        try:
            about = self._answer()
        except BaseException:
            self.close()
            raise
        self.layout: str | None = about["layout"]
        self.names: list[str] | None = about["names"]

    def __enter__(self) -> DetectorProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def ask(self, picture: np.ndarray | None, states: Sequence[State], *, search: Search = None) -> dict[str, Any]:
        """The detections in a picture (height, width, 3; uint8, BGR), or in the picture before.

        Returns "people", for each state None or its keypoints (K rows of x, y [px], confidence), perhaps their world (K
        rows of x, y, z [m]), and next state, and with `search` "starts", states of the people who seem to be there;
        "parts" looks closer than "whole". Raises InputError where it fails.
        """
        request: dict[str, Any] = {"states": list(states), "search": search}
        if picture is not None:
            request["size"] = [picture.shape[1], picture.shape[0]]
        stream = cast("IO[bytes]", self._child.stdin)
        try:
            stream.write(json.dumps(request).encode() + b"\n")
            if picture is not None:
                stream.write(np.ascontiguousarray(picture).data)
            stream.flush()
        except BrokenPipeError:
            pass  # it has ended: what it wrote is read below
        return self._answer()

    def close(self) -> None:
        """End it."""
        with suppress(OSError):
            cast("IO[bytes]", self._child.stdin).close()
        try:
            self._child.wait(self._patience.end)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        self._said.close()

    def _listen(self) -> None:
        for line in cast("IO[bytes]", self._child.stdout):
            self._lines.put(line)
        self._lines.put(b"")

    def _answer(self) -> dict[str, Any]:
        seconds = self._patience.answer
        try:
            line = self._lines.get(timeout=seconds)
        except queue.Empty:
            raise InputError(self._name, f"has not answered for {seconds:.0f} s", remedy="try again") from None
        answer = json.loads(line) if line else {"error": self._last_words()}
        if "error" in answer:
            raise InputError(answer.get("source", self._name), answer["error"], remedy=answer.get("remedy", ""))
        return cast("dict[str, Any]", answer)

    def _last_words(self) -> str:
        """The last output of a program that has ended."""
        code = self._child.wait()
        self._said.seek(0)
        lines = [line.strip() for line in self._said.read().decode(errors="replace").splitlines() if line.strip()]
        return f"ended with {code}: {lines[-1]}" if lines else f"ended with {code}"
