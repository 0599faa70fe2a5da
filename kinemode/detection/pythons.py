"""Pythons on this machine that an environment can be made with."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from humanoid.support.errors import InputError
from kinemode.detection.detectors import Patience
from kinemode.detection.requirements import Requirements, Version

_ASKED = """
import importlib.util, json, platform, sys
from importlib import metadata
packages = {(d.metadata["Name"] or "").lower().replace("_", "-"): d.version for d in metadata.distributions()}
print(json.dumps({
    "name": platform.python_implementation(),
    "version": list(sys.version_info[:2]),
    "venv": all(importlib.util.find_spec(name) for name in ("venv", "ensurepip")),
    "packages": packages,
}))
"""


@dataclass(frozen=True)
class Python:
    """An interpreter: what it is, whether it can make environments, and the packages that it has by name."""

    path: Path
    name: str
    version: Version
    venv: bool
    packages: dict[str, str]

    def fits(self, needed: Requirements) -> bool:
        """Whether it is of a version that the packages are there for."""
        return self.name == "CPython" and needed.lowest <= self.version < needed.beyond

    def has(self, needed: Requirements) -> bool:
        """Whether it has all packages already, in the versions that are needed."""
        pins = [package.partition(";") for package in needed.packages]
        exact = [tuple(pin.strip().split("==")) for pin, _, condition in pins if not condition]
        return self.fits(needed) and all(self.packages.get(name) == version for name, version in exact)


def alone(python: Path, *words: str) -> list[str]:
    """The command of a Python that looks at no variable and no packages of the user, and writes nothing beside code."""
    return [str(python), "-E", "-s", "-B", *words]


def clean_environment() -> dict[str, str]:
    """The variables of this process without those that would lead another Python, or an installer, to our packages."""
    ours = ("VIRTUAL_ENV", "CONDA_PREFIX", "__PYVENV_LAUNCHER__")
    return {name: v for name, v in os.environ.items() if name not in ours and not name.startswith("PYTHON")}


def asked(path: Path, patience: float = Patience.python) -> Python | None:
    """What an interpreter says of itself, None where it does not answer within so many seconds."""
    try:
        done = subprocess.run(
            alone(path, "-c", _ASKED),
            capture_output=True, text=True, timeout=patience, check=True, env=clean_environment(), cwd=os.sep,
        )  # fmt: skip
        told = json.loads(done.stdout)
        major, minor = told["version"]
        return Python(path, told["name"], (major, minor), told["venv"], told["packages"])
    except (OSError, subprocess.SubprocessError, ValueError, KeyError):
        return None


def named_python(path: Path, needed: Requirements, detector: str, patience: float = Patience.python) -> Python:
    """The Python that a user names; raises InputError where it is none, or of a version without the packages.

    patience: see `asked`.
    """
    given = Path(shutil.which(path) or path)
    python = asked(given.absolute(), patience) if given.exists() else None
    if python is None:
        raise InputError(path, "is no Python that answers", remedy=f"name the file of a CPython {needed.span}")
    if not python.fits(needed):
        version = "{} {}.{}".format(python.name, *python.version)
        raise InputError(path, f"is {version}", remedy=f"{detector} needs a CPython {needed.span}")
    return python


def fitting_python(needed: Requirements, patience: float = Patience.python) -> Python | None:
    """A Python of this machine that an environment can be made with, None where there is none.

    patience: see `asked`.
    """
    answers = (asked(path, patience) for path in dict.fromkeys(_candidates(needed)))
    return next((python for python in answers if python and python.venv and python.fits(needed)), None)


def _candidates(needed: Requirements) -> Iterator[Path]:
    yield Path(getattr(sys, "_base_executable", None) or sys.executable)
    for version in needed.versions:
        if path := shutil.which("python{}.{}".format(*version)):
            yield Path(path)
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv")
    for version in needed.versions:
        yield from sorted(pyenv.glob("versions/{}.{}*/bin/python".format(*version)), reverse=True)
    yield from (Path(path) for name in ("python3", "python") if (path := shutil.which(name)))
