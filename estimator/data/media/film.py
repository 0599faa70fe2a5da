"""Films: pictures written as H.264 (.mp4), VP9 (.webm) or GIF.

The encoder is the FFmpeg program that imageio-ffmpeg brings along, in a process of its own beside the FFmpeg that
OpenCV reads with. Frame times are those of the exact rate, 30000/1001 as well as 25. Equal pictures give equal files.
"""

from __future__ import annotations

import errno
import itertools
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import imageio_ffmpeg
import numpy as np

from humanoid.support.errors import InputError
from humanoid.support.files import replacing

_THREADS = "2"  # not the machine's number: an encoded film depends on it
_LARGEST_DENOMINATOR = 1001  # of a frame rate: 30000/1001
RATES = (0.01, 10000.0)
"""Frames per second that a film may have."""
_GIF_RATE = Fraction(25, 2)  # frames per second at most: each takes 8 hundredths of a second, the unit of a GIF
_GIF_LONGEST = 480  # longer side at most [px]
# errors of the disk by FFmpeg's exit code, 256 - errno
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS, errno.EACCES, errno.EPERM)


def write_film(path: str | Path, frames: Iterable[np.ndarray], rate: float, *, fine: bool = False) -> Path:
    """Write BGR frames (H, W, 3) uint8, all of one size, in the format that the path's ending names.

    The file is written whole or not at all. H.264 and VP9 have even sizes: the last column or row of an odd one is
    doubled. A GIF is reduced to 12.5 frames per second and 480 px.

    Parameters
    ----------
    rate: frames per second; the rates of television (30000/1001, ...) are met exactly.
    fine: for pictures that are measured: nearer to the frames, in a file about three times as large.

    Raises
    ------
    InputError: another ending, a rate outside `RATES`, no frame, or a file that cannot be written.
    """
    path = Path(path)
    check_film_name(path)
    if not RATES[0] <= rate <= RATES[1]:
        raise InputError(path, "frames per second must be {:g} to {:g}, got {:g}".format(*RATES, rate))
    with replacing(path) as temporary:
        stream = iter(frames)
        first = next(stream, None)
        if first is None:
            raise InputError(path, "has no frame to write")
        exact = Fraction(rate).limit_denominator(_LARGEST_DENOMINATOR)
        source = _pictures(first.shape[1], first.shape[0], exact)
        pictures = map(_even, itertools.chain([first], stream))
        if path.suffix.lower() == ".gif":
            _encode_gif(source, exact, pictures, temporary, path)
        else:
            _encode([*source, *FORMATS[path.suffix.lower()](exact, fine), f"file:{temporary}"], pictures, path)
    return path


def check_film_name(path: Path) -> None:
    """Raise InputError unless the path's ending names a format of `FORMATS`."""
    if path.suffix.lower() not in FORMATS:
        problem = f"{path.suffix} is not a film format" if path.suffix else "the name of a film needs an ending"
        raise InputError(path, problem, remedy=f"one of {', '.join(FORMATS)}")


def ffmpeg_command() -> list[str]:
    """The command that starts FFmpeg; raises InputError where none runs."""
    try:
        program = imageio_ffmpeg.get_ffmpeg_exe()
    except RuntimeError:
        raise InputError("imageio-ffmpeg", "has no FFmpeg that runs here", remedy="reinstall it") from None
    return [program, "-loglevel", "fatal", "-nostdin", "-y"]


def _pictures(width: int, height: int, rate: Fraction) -> list[str]:
    """FFmpeg, reading pictures from its standard input."""
    size = f"{width + width % 2}x{height + height % 2}"
    return [
        *ffmpeg_command(), "-f", "rawvideo", "-pix_fmt", "bgr24", "-s", size, "-framerate", str(rate), "-i", "pipe:0",
        "-map_metadata", "-1", "-fflags", "+bitexact", "-flags:v", "+bitexact", "-threads", _THREADS,
    ]  # fmt: skip


def _mp4(rate: Fraction, fine: bool, filters: str = "") -> list[str]:
    """`faststart` lets it play before it has been loaded whole."""
    quality = ["-preset", "medium", "-crf", "16" if fine else "20", "-g", _keys(rate)]
    return [*_yuv(filters), "-c:v", "libx264", *quality, "-movflags", "+faststart", "-f", "mp4"]


def _webm(rate: Fraction, fine: bool) -> list[str]:
    quality = ["-crf", "15" if fine else "30", "-b:v", "0", "-deadline", "good", "-cpu-used", "4", "-g", _keys(rate)]
    return [*_yuv(), "-c:v", "libvpx-vp9", *quality, "-f", "webm"]


def _gif(rate: Fraction, fine: bool) -> list[str]:
    """Filters of a GIF from two inputs, both the film: its palette is made from all of it, without keeping it in
    memory."""
    dithered = "[1:v][p]paletteuse=dither=bayer:bayer_scale=4:diff_mode=rectangle"
    return ["-filter_complex", f"[0:v]palettegen[p];{dithered}", "-loop", "0", "-fflags", "+bitexact", "-f", "gif"]


FORMATS: dict[str, Callable[[Fraction, bool], list[str]]] = {".mp4": _mp4, ".webm": _webm, ".gif": _gif}
"""FFmpeg's options by ending: of the frame rate, and whether the film is to be fine."""


def _yuv(filters: str = "") -> list[str]:
    """The colours that every player decodes: BT.709, 4:2:0, limited range, and labelled so."""
    scale = "scale=out_color_matrix=bt709:out_range=tv:flags=bicubic+accurate_rnd+full_chroma_int+bitexact"
    labels = "setparams=range=tv:color_primaries=bt709:color_trc=bt709:colorspace=bt709"
    return ["-vf", f"{filters}{scale},format=yuv420p,{labels}"]


def _keys(rate: Fraction) -> str:
    """Frames from one key frame to the next: about a second, so that players jump to any place at once."""
    return str(min(max(round(rate), 10), 250))


def _encode_gif(source: list[str], rate: Fraction, pictures: Iterable[np.ndarray], target: Path, path: Path) -> None:
    """Written through a reduced H.264 film, which is read twice."""
    side = f"min({_GIF_LONGEST}/max(iw\\,ih)\\,1)"
    reduced = f"fps={min(rate, _GIF_RATE)},scale=w=2*trunc(iw*{side}/2):h=2*trunc(ih*{side}/2):flags=area,"
    with tempfile.NamedTemporaryFile(prefix=target.name, suffix=".part", dir=target.parent) as film:
        _encode([*source, *_mp4(rate, True, reduced), f"file:{film.name}"], pictures, path)
        read = ["-i", f"file:{film.name}"]
        _encode([*ffmpeg_command(), *read, *read, *_gif(rate, False), f"file:{target}"], (), path)


def _even(frame: np.ndarray) -> np.ndarray:
    height, width = frame.shape[:2]
    return np.ascontiguousarray(np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge"))


def _encode(command: list[str], pictures: Iterable[np.ndarray], path: Path) -> None:
    """Run FFmpeg on pictures of even size; raises OSError where the disk is at fault, else InputError.

    A session of its own: Ctrl-C reaches this process alone. Signals ignored here are ignored there: a file that grows
    beyond a limit is an error then, and no death.
    """
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, stdin=pipe, stdout=subprocess.DEVNULL, stderr=pipe, start_new_session=True, restore_signals=False
    ) as process:
        assert process.stdin is not None
        assert process.stderr is not None
        try:
            with suppress(BrokenPipeError):  # the exit code gives the reason
                for picture in pictures:
                    process.stdin.write(picture.data)
            with suppress(BrokenPipeError):
                process.stdin.close()
            said = process.stderr.read().decode(errors="replace").strip()
        except BaseException:
            process.kill()
            with suppress(BrokenPipeError):
                process.stdin.close()
            raise
    _check(process.returncode, said, path)


def _check(code: int, said: str, path: Path) -> None:
    """Raise what FFmpeg's exit code and last words mean, unless it did well."""
    if 256 - code in _DISK:
        raise OSError(256 - code, os.strerror(256 - code))
    if code < 0:
        raise InputError(path, f"cannot be encoded: FFmpeg was ended by signal {-code}")
    if code > 0:
        raise InputError(path, f"cannot be encoded: {said.splitlines()[-1] if said else f'exit code {code}'}")
