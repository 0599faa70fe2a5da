"""Warnings about input and results."""

from __future__ import annotations


class InputWarning(UserWarning):
    """Something about the input that the user should know; the work continues."""


class FindingWarning(InputWarning):
    """A contradiction between a finished run and its subject or input (see `estimator.runs.diagnosis`)."""
