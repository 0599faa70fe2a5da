"""Ctrl-C and other terminating signals; the message about a run to resume; pasted commands."""

from __future__ import annotations

import shlex
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cyclopts
import numpy as np
import pytest

import kinemode
from humanoid.subject.subject import load_subject
from humanoid.support.errors import InputError
from kinemode import __main__ as front, cli, jobs
from kinemode.annotation import annotate
from kinemode.demo import make_clip
from kinemode.progress import unreported
from kinemode.shot import RenderedClip
from kinemode.target import check_folder
from kinemode.terminal import program, report
from kinemode.terminal.interruption import interrupted_by_signals, kept_if_interrupted
from tests.waiting import DEADLINE

pytestmark = pytest.mark.usefixtures("default_signals")


def send_here(number: signal.Signals) -> None:
    """Send this process a signal. AssertionError where there is no handler, as the signal would end the suite
    silently."""
    assert signal.getsignal(number) is not signal.SIG_DFL, f"{number.name} is not taken"
    signal.raise_signal(number)


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_signals_end_a_command_with_one_line(
    number: signal.Signals, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def signalled(*_: Any, **__: Any) -> None:
        send_here(number)
        pytest.fail(f"{number.name} has not ended the command")

    monkeypatch.setattr(cli, "run_command", signalled)
    before = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    assert front.main(["subjects"]) == code
    assert capsys.readouterr().err == "interrupted\n"
    assert [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before


@pytest.mark.parametrize("twice", [False, True])
@pytest.mark.parametrize("cause", [KeyboardInterrupt(), ValueError()])
def test_compiled_code_may_make_something_else_of_it(
    cause: BaseException, twice: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Python itself does, where a call from C swallows an exception."""

    def broken(*_: Any) -> None:
        with kept_if_interrupted(lambda: 3):
            try:  # a call that makes several arrays swallows it more than once
                raise SystemError("returned a result with an exception set") from cause
            except SystemError as first:
                if not twice:
                    raise
                raise SystemError("returned a result with an exception set") from first

    monkeypatch.setattr(cli, "run_command", broken)
    code = front.main(["track", "a.mp4"])
    message = capsys.readouterr().err
    if isinstance(cause, KeyboardInterrupt):
        assert (code, message.partition(", resume")[0]) == (front.INTERRUPTED, "interrupted; what was tracked is kept")
    else:
        assert code == front.INTERNAL_ERROR


def test_only_the_first_signal_counts_but_ctrl_c_always_does() -> None:
    with interrupted_by_signals() as came:
        for number in (signal.SIGTERM, signal.SIGINT):
            with pytest.raises(KeyboardInterrupt):
                send_here(number)
            send_here(signal.SIGTERM)
    assert came == [signal.SIGTERM, signal.SIGTERM, signal.SIGINT, signal.SIGTERM]


def test_an_ignored_signal_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    try:
        with interrupted_by_signals() as came:
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert came == []


def test_a_signal_is_not_lost_where_nothing_can_be_raised() -> None:
    class Finalised:
        def __del__(self) -> None:
            send_here(signal.SIGTERM)

    def lose_one() -> None:
        assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL  # the other assertion would be lost
        Finalised()
        threading.Event().wait(DEADLINE)

    with interrupted_by_signals() as came, pytest.raises(KeyboardInterrupt):
        lose_one()
    assert came[0] == signal.SIGTERM


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> RenderedClip:
    return make_clip(tmp_path_factory.mktemp("a clip"), frames=2, videos=False, progress=unreported)


@pytest.fixture
def track(clip: RenderedClip, tmp_path: Path) -> list[str]:
    """A command line that tracks two frames."""
    keypoints = next(iter(clip.keypoints.values()))
    line = ["track", "--keypoints", str(keypoints), "--cameras", str(clip.cameras), "--fit", "off", "--modes", "2"]
    return [*line, "--out", str(tmp_path / "a run")]


def interrupted(*_: Any, **__: Any) -> Any:
    raise KeyboardInterrupt


def test_no_resume_command_without_a_run(
    track: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(jobs, "_fitted", interrupted)
    for more in ([], ["--resume"]):
        assert front.main([*track, *more]) == front.INTERRUPTED
        assert capsys.readouterr().err.splitlines()[-1] == "interrupted"
    Path(track[-1]).write_text("an old run")
    assert front.main([*track, "--overwrite"]) == front.INTERRUPTED
    assert capsys.readouterr().err.splitlines()[-1] == "interrupted"
    assert Path(track[-1]).read_text() == "an old run"


def test_the_printed_command_resumes(
    track: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Before the first frame, in the middle, and at the start of a resumed run."""

    def how_to_go_on(line: list[str], where: str, stopped: Callable[..., Any]) -> tuple[str, list[str]]:
        with monkeypatch.context() as patched:
            patched.setattr(jobs, where, stopped)
            assert front.main(line) == front.INTERRUPTED
        kept, _, command = capsys.readouterr().err.splitlines()[-1].partition(", resume with: ")
        return kept, shlex.split(command)

    whole, run_into = [*track, "--resume"], jobs.run_into

    def stops_after_one(*args: Any, **how: Any) -> None:
        run_into(*args, **{**how, "progress": interrupted})

    expected = ["kinemode", *whole]
    assert how_to_go_on(track, "run_into", interrupted) == ("interrupted; no frame was tracked yet", expected)
    assert how_to_go_on(whole, "run_into", stops_after_one) == ("interrupted; what was tracked is kept", expected)
    assert how_to_go_on(whole, "_fitted", interrupted) == ("interrupted; what was tracked is kept", expected)
    assert how_to_go_on(whole, "smooth_track", interrupted) == ("interrupted; what was tracked is kept", expected)
    assert front.main(expected[1:]) == 0
    assert kinemode.open_run(track[-1]).complete


def parsed(line: str) -> list[str]:
    """The arguments of a command after the program's name, as the command line parses them."""
    words = shlex.split(line)
    assert words[0] == "kinemode"
    cli.app.parse_args(words[1:], exit_on_error=False, print_error=False)
    return words[1:]


@pytest.mark.parametrize(
    ("given", "again"),
    [
        (["track", "my walk.mp4", "--out", "a"], ["track", "my walk.mp4", "--out", "a", "--resume"]),
        (["track", "--overwrite", "--out=a b", "c"], ["track", "--out=a b", "c", "--resume"]),
        (["track", "--out", "a", "--resume", "--keypoints", "b", "c"],
         ["track", "--out", "a", "--keypoints", "b", "c", "--resume"]),
        (["track", "--out", "a", "--overwrite=true", "--", "-b.mp4"],
         ["track", "--out", "a", "--resume", "--", "-b.mp4"]),
        (["compare", "a", "--out", "b", "--trackers", "css", "$HOME"],
         ["compare", "a", "--out", "b", "--trackers", "css", "$HOME", "--resume"]),
    ],
)  # fmt: skip
def test_the_resume_command_can_be_pasted(given: list[str], again: list[str]) -> None:
    message = front._how_to_go_on(given, front.RunInterrupted(1))
    assert parsed(message.partition("resume with: ")[2]) == again


def test_what_is_suggested_can_be_pasted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report, "findings", lambda _: ())
    cli.app.parse_args(["track", "a", "--out", "b"], exit_on_error=False, print_error=False)
    with pytest.raises(cyclopts.CycloptsError):  # the check can fail
        parsed("kinemode track --ou b")
    for file in (Path("my walk.run"), Path("-x.run"), tmp_path / "it's [red].run"):
        body = SimpleNamespace(nv=1, bounded_q=np.zeros(1))
        run: Any = SimpleNamespace(
            file=file, status=np.array(["tracked"]), time=np.zeros(1), body=body, mode_penetration=np.zeros(1),
            planned_count=1, subject=SimpleNamespace(name="a"), hypothesis_count=1, __len__=1,
        )  # fmt: skip
        run = type("Run", (SimpleNamespace,), {"__len__": lambda _: 1})(**vars(run))
        report.print_run(run)
        lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
        commands = [parsed(line) for line in lines[lines.index("next:") + 1 :]]
        assert [words[0] for words in commands] == ["view", "overlay", "export"]
        assert all(Path(words[1]) == file for words in commands)
        line = annotate._next(Path("my clip.mp4"), "left=", load_subject("arm8"), Path("-clicks.json"))
        assert parsed(line)[:2] == ["track", "left==my clip.mp4"]
    line = annotate._next(Path("-walk.mp4"), None, load_subject("human34"), Path("-clicks.json"))
    assert parsed(line) == ["track", "walk=-walk.mp4", "--keypoints", "walk=-clicks.json", "--out", "./-walk.run"]
    folder = tmp_path / "a folder" / "b"
    with pytest.raises(InputError) as raised:
        check_folder(folder / "a.run")
    subprocess.run(raised.value.remedy, shell=True, check=True, timeout=DEADLINE)
    assert folder.is_dir()


def test_a_wrong_option_names_the_command_with_the_right_ones(capsys: pytest.CaptureFixture[str]) -> None:
    for line, command in ((["track", "--ou", "b"], "kinemode track --help"), (["trak"], "kinemode --help")):
        assert front.main(line) == front.BAD_INPUT
        assert f"(see {command})" in capsys.readouterr().err


def test_the_program_is_named_as_it_was_called(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    installed = tmp_path / "bin" / "kinemode"
    installed.parent.mkdir()
    installed.touch(mode=0o755)
    monkeypatch.setattr(sys, "argv", [str(installed), "track"])
    assert program.command("view", "a b") == f"{installed} view 'a b'"
    monkeypatch.setenv("PATH", str(installed.parent))
    assert program.command("view") == "kinemode view"
    monkeypatch.setattr(sys, "argv", [".venv/bin/kinemode"])
    assert program.command("view") == ".venv/bin/kinemode view"
    monkeypatch.setattr(sys, "argv", ["/somewhere/kinemode/__main__.py"])
    monkeypatch.setattr(sys, "orig_argv", ["python3", "-W", "ignore", "-m", "kinemode", "track", "-m", "kinemode"])
    assert program.command("view") == "python3 -W ignore -m kinemode view"
    monkeypatch.setattr(sys, "argv", ["a_script.py"])
    monkeypatch.setattr(sys, "orig_argv", ["python", "a_script.py"])
    assert program.command("view") == "kinemode view"
