"""The command line: the commands of `kinemode.commands` under one name.

Only light modules are imported here: `kinemode --help` must not wait for Pinocchio and numba.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence

from cyclopts import App

import kinemode
from kinemode.commands import clips, preparation, results, tracking

app = App(
    name="kinemode",
    version=kinemode.__version__,
    help_format="plaintext",
    suppress_keyboard_interrupt=False,  # `main` prints how to resume
    help="""How a person, or any body with a URDF, moved in a clip: joint angles as several weighted hypotheses.

Start with `kinemode demo`. Errors are one line; `--debug` anywhere on the line shows where they come from.""",
)


def run_command(arguments: Sequence[str]) -> None:
    """Parse and run one command line; every exception reaches the caller, warnings become one line each."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        warnings.showwarning = _note
        app(list(arguments), exit_on_error=False, print_error=False, result_action="return_value")


def _note(message: Warning | str, *_: object, **__: object) -> None:
    from humanoid.support.errors import shortened  # its package takes as long to import as all others

    print("note:", shortened(" ".join(str(message).split())), file=sys.stderr)


def version() -> None:
    """Print the version."""
    print(kinemode.__version__)


for command in (
    clips.demo,
    clips.annotate,
    clips.render,
    clips.detect,
    tracking.track,
    tracking.compare,
    tracking.live,
    tracking.batch,
    tracking.retarget,
    preparation.fit,
    preparation.calibrate,
    preparation.train_index,
    preparation.train_templates,
    preparation.settings,
    preparation.subjects,
    preparation.trackers,
    preparation.cues,
    results.view,
    results.overlay,
    results.plot,
    results.samples,
    results.report,
    results.explain,
    results.export,
    results.contact,
    results.gait,
    results.forces,
    results.evaluate,
    version,
):
    app.command(command)
