"""Entry point of the command `kinemode`: what goes wrong becomes one line, or one for each fault of a manifest, and an
exit code."""

from __future__ import annotations

import errno
import os
import sys
import traceback
from collections.abc import Sequence

from kinemode.terminal.interruption import RunInterrupted, interrupted_by_signals, is_interruption
from kinemode.terminal.program import command

BAD_INPUT = 2
INTERNAL_ERROR = 1
INTERRUPTED = 130  # what a shell gives a process ended by Ctrl-C
_SIGNALLED = 128  # and the number of the signal: the same for the others


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0, 1 (our fault), 2 (the input's), 130 (Ctrl-C) or 143 (SIGTERM)."""
    given = list(sys.argv[1:] if argv is None else argv)
    debug = "--debug" in given
    arguments = [a for a in given if a != "--debug"]
    with interrupted_by_signals() as signals:
        try:
            from kinemode.cli import run_command

            run_command(arguments)
            sys.stdout.flush()
        except (KeyboardInterrupt, SystemError) as stop:
            if isinstance(stop, SystemError) and not is_interruption(stop):
                return _report(stop, debug)
            _say(_how_to_go_on(arguments, stop))
            return _SIGNALLED + signals[0] if signals else INTERRUPTED
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
        first, *others = problem.split("\n") if isinstance(error, _several_faults()) else [problem]
        _say(f"error: {first}")
        for fault in others:
            _say(fault, "  ")
        return BAD_INPUT
    hint = "" if debug else "; run with --debug and report what it shows"
    _say(f"internal error: {type(error).__name__}: {error}{hint}")
    return INTERNAL_ERROR


def _several_faults() -> type[Exception]:
    """The class of errors whose message has a line for each fault."""
    from kinemode.batches.tables import ManifestError

    return ManifestError


def _users_problem(error: Exception) -> str | None:
    """The message of an error that the user can fix; None for an internal one."""
    from cyclopts import CycloptsError

    from humanoid.support.errors import InputError, shortened

    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, CycloptsError):
        return f"{shortened(str(error))} (see {command(*(error.command_chain or ()), '--help')})"
    if isinstance(error, OSError) and error.filename is not None:
        return str(InputError(error.filename, error.strerror or type(error).__name__))
    return f"standard output: cannot be written: {error}" if _no_room(error) else None


_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def _no_room(error: Exception) -> bool:
    """The disk that standard output goes to takes no more; our own files are written by functions that name them."""
    return isinstance(error, OSError) and error.filename is None and error.errno in _FULL


def _drop_output() -> None:
    """Drop pending output, which would fail again when the process ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _say(text: str, indent: str = "") -> None:
    print(indent + " ".join(text.split()), file=sys.stderr)


def _how_to_go_on(arguments: list[str], stop: BaseException) -> str:
    if not isinstance(stop, RunInterrupted):
        return str(stop) if isinstance(stop, KeyboardInterrupt) and str(stop) else "interrupted"
    kept = "what was tracked is kept" if stop.frames else "no frame was tracked yet"
    return f"interrupted; {kept}, resume with: {command(*_resuming(arguments))}"


def _resuming(arguments: list[str]) -> list[str]:
    """The command line that continues what a command line began."""
    again = [a for a in arguments if a.partition("=")[0] not in ("--resume", "--overwrite")]
    end = again.index("--") if "--" in again else len(again)  # beyond it everything is a clip
    return [*again[:end], "--resume", *again[end:]]


if __name__ == "__main__":
    sys.exit(main())
