"""The compiled part of `skin`."""

from __future__ import annotations

import numpy as np

from humanoid.support.compiled import jit


@jit
def shares_of_colours(picture, steps, total, bins):  # type: ignore[no-untyped-def]
    """Of a picture (H, W, 3) uint8 BGR fill total (H, W) int32, the sums of B, G and R, and bins (H, W, 2) int32, the
    shares of red and green in them in `steps` (float32, at most 1,000) steps.

    A quotient of such small whole numbers is either one itself or so far from one that float32 rounds it to none.
    """
    for y in range(picture.shape[0]):
        colours, sums, shares = picture[y], total[y], bins[y]
        for x in range(picture.shape[1]):
            green, red = np.int32(colours[x, 1]), np.int32(colours[x, 2])
            sums[x] = np.int32(colours[x, 0]) + green + red
            more = np.float32(sums[x] + 1)
            shares[x, 0] = np.int32(np.float32(red) * steps / more)
            shares[x, 1] = np.int32(np.float32(green) * steps / more)


@jit
def mark_skin(total, bins, likely, least, mask):  # type: ignore[no-untyped-def]
    """Fill mask (H, W) uint8 with whether a colour is likely, (64, 64) bool, and its sum total (H, W) at least `least`;
    bins (H, W, 2) int32 are the row and column of each."""
    for y in range(total.shape[0]):
        for x in range(total.shape[1]):
            mask[y, x] = likely[bins[y, x, 0], bins[y, x, 1]] and total[y, x] >= least
