"""The environment of a detector: made once in the user's cache, with packages that never meet ours."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from humanoid.support.atomic import replacing
from humanoid.support.compiled_folder import cache_roots, locked
from humanoid.support.errors import InputError
from kinemode.detection.detectors import Patience
from kinemode.detection.pythons import Python, alone, clean_environment, fitting_python, named_python
from kinemode.detection.requirements import Requirements, read_requirements
from kinemode.notices import InputWarning
from kinemode.target import cache_folder

STAMP = "ready.json"
PATIENCE = Patience()


def python_for(detector: str, script: Path, given: Path | None = None, patience: Patience = PATIENCE) -> Path:
    """The Python that runs a detector's program: of the environment in the cache, which is made where it is not there.

    given: a Python to make it with; one that has the packages itself is taken as it is.

    Raises
    ------
    InputError: no Python that fits, or packages that cannot be had; with what to do about it.
    """
    needed = read_requirements(script)
    base = None if given is None else named_python(given, needed, detector, patience.python)
    if base is not None and base.has(needed):
        return base.path
    name = f"detector-{detector}-{needed.digest}"
    for root in cache_roots():
        if _is_ready(root / name, needed):
            return _python_of(root / name)
    folder = cache_folder() / name
    try:
        with locked(folder.with_suffix(".lock")):
            if not _is_ready(folder, needed):  # another process may have made it meanwhile
                _make(folder, detector, needed, base, patience)
    except OSError as error:
        raise InputError(folder, f"cannot be made: {error.strerror}", remedy="KINEMODE_CACHE names another") from None
    return _python_of(folder)


def is_made(detector: str, script: Path) -> bool:
    """Whether the environment of a detector is there."""
    needed = read_requirements(script)
    return any(_is_ready(root / f"detector-{detector}-{needed.digest}", needed) for root in cache_roots())


def _python_of(folder: Path) -> Path:
    return folder / "bin" / "python"


def _is_ready(folder: Path, needed: Requirements) -> bool:
    """Whether an environment is whole: its stamp was written last; and the Python that it was made with still there."""
    with suppress(OSError, ValueError, TypeError, KeyError):
        stamp = json.loads((folder / STAMP).read_text(encoding="utf-8"))
        return bool(stamp["packages"] == list(needed.packages)) and os.access(_python_of(folder), os.X_OK)
    return False


def _make(folder: Path, detector: str, needed: Requirements, base: Python | None, patience: Patience) -> None:
    """Make the environment; what an interrupted attempt has left goes first, and the stamp comes last."""
    uv = shutil.which("uv")
    python = base or (None if uv else fitting_python(needed, patience.python))
    if uv is None and python is None:
        problem = f"needs a CPython {needed.span} (with venv), and there is none here"
        remedy = "install one, or uv, which fetches it; --python PATH names one elsewhere"
        raise InputError(detector, problem, remedy=remedy)
    said = f"{detector} gets an environment of its own, once: {len(needed.packages)} packages into {folder}"
    warnings.warn(said, InputWarning, stacklevel=2)
    shutil.rmtree(folder, ignore_errors=True)
    wanted = needed.python if python is None else str(python.path)
    if uv is not None:
        made = [uv, "venv", "--quiet", "--no-project", "--python", wanted, str(folder)]
        filled = [uv, "pip", "install", "--quiet", "--no-deps", "--python", str(_python_of(folder))]
    else:
        made = alone(Path(wanted), "-m", "venv", str(folder))
        filled = alone(_python_of(folder), "-m", "pip", "install", "--quiet", "--no-deps", "--no-input")
        filled += ["--disable-pip-version-check"]
    for words in (made, [*filled, *needed.packages]):
        _run(words, detector, needed, patience.installation)
    with replacing(folder / STAMP) as temporary:
        temporary.write_text(json.dumps({"packages": needed.packages, "made_with": wanted}), encoding="utf-8")


def _run(words: Sequence[str], detector: str, needed: Requirements, seconds: float) -> None:
    """One step of making it, in so many seconds; raises InputError with the last thing that the installer said."""
    first = needed.packages[0]
    offline = f"it takes a network, once; or --python PATH: a CPython {needed.span} that has {first} and what it needs"
    try:
        subprocess.run(
            words, check=True, capture_output=True, text=True, timeout=seconds, env=clean_environment(),
            stdin=subprocess.DEVNULL,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise InputError(detector, f"was not installed within {seconds / 60:.0f} minutes", remedy=offline) from None
    except subprocess.CalledProcessError as error:
        raise InputError(detector, f"cannot be installed: {_last_error(error)}", remedy=offline) from None


def _last_error(error: subprocess.CalledProcessError) -> str:
    lines = [line.strip() for line in f"{error.stdout}\n{error.stderr}".splitlines() if line.strip()]
    told = [line for line in lines if "error" in line.lower()] or lines
    return told[-1] if told else f"{Path(error.cmd[0]).name} ended with {error.returncode}"
