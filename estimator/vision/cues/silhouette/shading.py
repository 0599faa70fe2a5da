"""Whether a picture shows the background at another brightness: compiled."""

from __future__ import annotations

import numpy as np

from humanoid.support.compiled import jit

WINDOW = 7  # pixels across in which the texture of image and background is compared


@jit
def mark_brightness(picture, mean, scale, darkest, brightest, most, least, possible, other):  # type: ignore[no-untyped-def]
    """Mark where a picture (H, W, 3) uint8 has the background's colour, and where at another brightness.

    mean, scale (H, W, 3) float32: the background's colours and the inverse of their spread. darkest, brightest: shares
    of the background's brightness that it may have there. most: squared difference of colour, in standard deviations.
    least: change of brightness that counts. All float32. Fills possible, other (H, W) bool.
    """
    height, width = possible.shape
    whole, tiny = np.float32(1.0), np.float32(1e-6)
    seen, expected = np.empty(3 * width, np.float32), np.empty(3 * width, np.float32)
    for y in range(height):
        colours, means, scales = picture[y].ravel(), mean[y].ravel(), scale[y].ravel()
        for i in range(3 * width):  # side by side, for the processor's vector units
            seen[i], expected[i] = np.float32(colours[i]) * scales[i], means[i] * scales[i]
        for x in range(width):
            b, g, r = expected[3 * x], expected[3 * x + 1], expected[3 * x + 2]
            in_b, in_g, in_r = seen[3 * x], seen[3 * x + 1], seen[3 * x + 2]
            ratio = (in_b * b + in_g * g + in_r * r) / max(b * b + g * g + r * r, tiny)
            off_b, off_g, off_r = in_b - ratio * b, in_g - ratio * g, in_r - ratio * r
            off = off_b * off_b + off_g * off_g + off_r * off_r
            possible[y, x] = (ratio > darkest) & (ratio < brightest) & (off < most)
            other[y, x] = abs(ratio - whole) > least


@jit
def mark_texture(seen, expected, noise, unexplained, shows, textured):  # type: ignore[no-untyped-def]
    """Mark where the background's texture, brighter or darker, explains the picture's, and where it has any.

    seen, expected (H + WINDOW - 1, W + WINDOW - 1) float32: brightness of picture and background, with what the windows
    see beyond the border. noise (float32): variance that is none. unexplained (float32):
    share of the texture's variance that may differ. Fills shows, textured (H, W) bool.
    """
    height, width = shows.shape
    across = width + WINDOW - 1
    sums = np.zeros((5, across))  # down each column of the window
    totals = np.empty((5, width), np.float32)
    whole, two, four = np.float32(1.0), np.float32(2.0), np.float32(4.0)
    for y in range(height + WINDOW - 1):
        _count(seen[y], expected[y], 1.0, sums)
        if y < WINDOW - 1:
            continue
        for k in range(5):
            _windows(sums[k], totals[k])
        top = y - WINDOW + 1
        a_mean, b_mean, a_square, b_square, product = totals[0], totals[1], totals[2], totals[3], totals[4]
        explained, any_texture = shows[top], textured[top]
        for x in range(width):
            a, b = a_mean[x], b_mean[x]
            gain = a / max(b, whole)
            texture = gain * gain * (b_square[x] - b * b)
            rest = a_square[x] - a * a - two * gain * (product[x] - a * b) + texture
            explained[x] = rest < max(unexplained * texture, noise)
            any_texture[x] = texture > four * noise
        _count(seen[top], expected[top], -1.0, sums)


@jit
def _count(seen, expected, sign, sums):  # type: ignore[no-untyped-def]
    """Add a row of two pictures, seen and expected (W,), of their squares and product to sums (5, W), or with sign -1
    take it away. Squares have the precision of the pictures, so that in sums of float64 nothing is lost."""
    for x in range(len(seen)):
        a, b = seen[x], expected[x]
        sums[0, x] += sign * a
        sums[1, x] += sign * b
        sums[2, x] += sign * (a * a)
        sums[3, x] += sign * (b * b)
        sums[4, x] += sign * (a * b)


@jit
def _windows(sums, totals):  # type: ignore[no-untyped-def]
    """Fill totals (W,) float32 with the means of windows, of the sums (W + WINDOW - 1,) down their columns."""
    width = len(totals)
    share = 1.0 / (WINDOW * WINDOW)
    s0, s1, s2, s3 = sums[:width], sums[1 : 1 + width], sums[2 : 2 + width], sums[3 : 3 + width]
    s4, s5, s6 = sums[4 : 4 + width], sums[5 : 5 + width], sums[6 : 6 + width]
    for x in range(width):  # written out, for the processor's vector units
        totals[x] = (s0[x] + s1[x] + s2[x] + s3[x] + s4[x] + s5[x] + s6[x]) * share
