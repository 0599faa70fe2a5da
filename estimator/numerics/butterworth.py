"""The low-pass filter of movement analysis: Butterworth, fourth order, without lag.

A filter of second order is run forwards and backwards (Winter, *Biomechanics and Motor Control of Human Movement*, 4th
ed. 2009, section 2.2.4.4). Two passes would let less through than one, so each gets a higher cut-off, by the factor
(sqrt(2) - 1)^(-1/4) = 1 / 0.802 in the tangent of the frequency; then the amplitude at the cut-off that was asked for
is 1 / sqrt(2) after both.
"""

from __future__ import annotations

from typing import cast

import numpy as np

_PASSES = 2
_CORRECTION = (2.0 ** (1.0 / _PASSES) - 1.0) ** 0.25
_PERIODS = 3.0
"""Periods of the cut-off by which a signal is continued at both ends: the filter's start is then below 1e-7 of it."""


def gain(frequency: np.ndarray | float, cutoff: float, rate: float) -> np.ndarray:
    """Factor (...) of the amplitude of a sine of this frequency (...) [Hz]; cut-off and sampling rate [Hz]."""
    ratio = np.tan(np.pi * np.asarray(frequency) / rate) / _edge(cutoff, rate)
    return np.asarray(1.0 / (1.0 + ratio**4))


def extension(cutoff: float, rate: float) -> int:
    """Samples by which a signal has to be continued at both ends for `low_pass`."""
    return int(np.ceil(_PERIODS * rate / cutoff)) + 1


def low_pass(samples: np.ndarray, cutoff: float, rate: float, extended: int) -> np.ndarray:
    """Filtered samples (N, ...), the continuation (see `extension`) cut off again.

    samples (N + 2 extended, ...): evenly spaced, continued at both ends. cutoff [Hz] is below half the rate [Hz].
    """
    from scipy.signal import butter, sosfiltfilt  # takes long to import

    ends = 2.0 / np.pi * np.arctan(_edge(cutoff, rate))  # of half the rate
    filtered = sosfiltfilt(butter(2, ends, output="sos"), samples, axis=0, padtype=None)
    return cast(np.ndarray, filtered[extended : len(samples) - extended])


def _edge(cutoff: float, rate: float) -> float:
    """Tangent of the cut-off of one pass, as the bilinear transform has it."""
    return float(np.tan(np.pi * cutoff / rate)) / _CORRECTION
