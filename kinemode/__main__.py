"""Entry point of the command `kinemode`: what goes wrong becomes one line and an exit code."""

from __future__ import annotations

import errno
import os
import shlex
import sys
import traceback
from collections.abc import Sequence

BAD_INPUT = 2
INTERNAL_ERROR = 1
INTERRUPTED = 130  # what a shell gives a process ended by Ctrl-C


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0, 1 (our fault), 2 (the input's) or 130 (Ctrl-C)."""
    given = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in given
    arguments = [a for a in given if a != "--debug"]
    try:
        from kinemode.cli import run_command

        run_command(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt as stop:
        _say(str(stop) or _how_to_go_on(arguments))
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output (head, less) has left
        _drop_output()
        return 0
    except Exception as error:
        if _no_room(error):
            _drop_output()
        return _report(error, debug)
    return 0


def _report(error: Exception, debug: bool) -> int:
    if debug:
        traceback.print_exception(type(error), error, error.__traceback__)
    problem = _users_problem(error)
    if problem is not None:
        _say(f"error: {problem}")
        return BAD_INPUT
    hint = "" if debug else "; run with --debug and report what it shows"
    _say(f"internal error: {type(error).__name__}: {error}{hint}")
    return INTERNAL_ERROR


def _users_problem(error: Exception) -> str | None:
    """What the user can do something about; None where the fault is ours."""
    from cyclopts import CycloptsError

    from humanoid.errors import InputError, shortened

    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, CycloptsError):
        return f"{shortened(str(error))} (see kinemode --help)"
    if isinstance(error, OSError) and error.filename is not None:
        return str(InputError(error.filename, error.strerror or type(error).__name__))
    return f"standard output: cannot be written: {error}" if _no_room(error) else None


def _no_room(error: Exception) -> bool:
    """The disk that standard output goes to takes no more; our own files are written by functions that name them."""
    return isinstance(error, OSError) and error.filename is None and error.errno in (errno.ENOSPC, errno.EDQUOT)


def _drop_output() -> None:
    """What is still to be written would fail again when the process ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _say(text: str) -> None:
    print(" ".join(text.split()), file=sys.stderr)


def _how_to_go_on(arguments: list[str]) -> str:
    if arguments[:1] not in (["track"], ["compare"]):
        return "interrupted"
    again = [*(a for a in arguments if a not in ("--resume", "--overwrite")), "--resume"]
    return f"interrupted; what was tracked is kept, go on with: kinemode {shlex.join(again)}"


if __name__ == "__main__":
    sys.exit(main())
