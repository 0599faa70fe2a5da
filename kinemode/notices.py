"""What is said of input and results while the work goes on, as Python's warnings."""

from __future__ import annotations


class InputWarning(UserWarning):
    """Something about the input that the user should know; the work goes on."""


class FindingWarning(InputWarning):
    """What a finished run says against its subject or its input (see `estimator.runs.diagnosis`)."""
