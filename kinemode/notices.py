"""Warnings about input and results."""

from __future__ import annotations


class InputWarning(UserWarning):
    """Something about the input that the user should know; the work goes on."""


class FindingWarning(InputWarning):
    """What in a finished run contradicts its subject or its input (see `estimator.runs.diagnosis`)."""
