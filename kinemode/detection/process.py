"""A detector's program, which runs while pictures are shown to it; `scripts/serving.py` is its side of the talk."""

from __future__ import annotations

import json
import os
import queue
import subprocess
import tempfile
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import IO, Any, cast

import numpy as np

from humanoid.support.errors import InputError
from kinemode.detection.detectors import DetectorChoice
from kinemode.detection.environment import alone, clean_environment, python_for
from kinemode.detection.people import Search, State


class DetectorProcess:
    """A running detector; a context manager, which ends it.

    layout: of its keypoints, None where only their count is known. names (K): of its keypoints, or None.
    """

    def __init__(self, wanted: DetectorChoice) -> None:
        self._name, self._patience = wanted.name, wanted.patience
        self._said = tempfile.TemporaryFile()  # noqa: SIM115, closed by `close`
        python = python_for(wanted.name, wanted.script, wanted.python, self._patience)
        # in a session of its own Ctrl-C does not reach it: it ends when we do, with its standard input
        self._child = subprocess.Popen(
            alone(python, str(wanted.script), json.dumps(wanted.options)),
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._said,
            env=clean_environment() | {"GLOG_minloglevel": "2", "TF_CPP_MIN_LOG_LEVEL": "2"}, cwd=os.sep,
            start_new_session=True,
        )  # fmt: skip
        self._lines: queue.Queue[bytes] = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()
        try:
            about = self._answer()
        except BaseException:
            self.close()
            raise
        self.layout: str | None = about["layout"]
        self.names: list[str] | None = about["names"]

    def __enter__(self) -> DetectorProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def ask(self, picture: np.ndarray | None, states: Sequence[State], *, search: Search = None) -> dict[str, Any]:
        """What it sees in a picture (height, width, 3; uint8, BGR), or in the picture before.

        Returns "people", for each state None or its keypoints (K rows of x, y [px], confidence), perhaps their world (K
        rows of x, y, z [m]), and next state, and with `search` "starts", states of the people who seem to be there;
        "parts" looks closer than "whole". Raises InputError where it fails.
        """
        request: dict[str, Any] = {"states": list(states), "search": search}
        if picture is not None:
            request["size"] = [picture.shape[1], picture.shape[0]]
        stream = cast("IO[bytes]", self._child.stdin)
        try:
            stream.write(json.dumps(request).encode() + b"\n")
            if picture is not None:
                stream.write(np.ascontiguousarray(picture).data)
            stream.flush()
        except BrokenPipeError:
            pass  # it has ended: what it wrote is read below
        return self._answer()

    def close(self) -> None:
        """End it."""
        with suppress(OSError):
            cast("IO[bytes]", self._child.stdin).close()
        try:
            self._child.wait(self._patience.end)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        self._said.close()

    def _listen(self) -> None:
        for line in cast("IO[bytes]", self._child.stdout):
            self._lines.put(line)
        self._lines.put(b"")

    def _answer(self) -> dict[str, Any]:
        seconds = self._patience.answer
        try:
            line = self._lines.get(timeout=seconds)
        except queue.Empty:
            raise InputError(self._name, f"has not answered for {seconds:.0f} s", remedy="try again") from None
        answer = json.loads(line) if line else {"error": self._last_words()}
        if "error" in answer:
            raise InputError(answer.get("source", self._name), answer["error"], remedy=answer.get("remedy", ""))
        return cast("dict[str, Any]", answer)

    def _last_words(self) -> str:
        """What a program that has ended wrote last."""
        code = self._child.wait()
        self._said.seek(0)
        lines = [line.strip() for line in self._said.read().decode(errors="replace").splitlines() if line.strip()]
        return f"ended with {code}: {lines[-1]}" if lines else f"ended with {code}"
