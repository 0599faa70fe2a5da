"""Warnings about input and results."""

from __future__ import annotations

import sys
import warnings


class InputWarning(UserWarning):
    """Something about the input that the user should know; the work continues."""


class FindingWarning(InputWarning):
    """A contradiction between a finished run and its subject or input (see `estimator.runs.diagnosis`)."""


def warn(message: str, category: type[Warning] = InputWarning) -> None:
    """Warn the user at the line outside of kinemode that called it, from whatever depth."""
    frame, level = sys._getframe(1), 2
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in ("kinemode", "contextlib"):
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)
