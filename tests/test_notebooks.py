"""The notebooks run from the first cell to the last, assert their own claims, and are stored without outputs."""

from __future__ import annotations

import ast
import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest

import kinemode as km
from benchmarks.support.common import ROOT
from tests.waiting import DEADLINE

FOLDER = ROOT / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
PATIENCE = dict.fromkeys(("timeout", "startup_timeout", "iopub_timeout"), round(DEADLINE))
"""For the kernel's start, a cell (the first may compile), and a cell's output, which arrives after its end."""
LINK = re.compile(r"\]\(([^)\s]+)\)")


def read(path: Path) -> Any:
    return json.loads(path.read_text(encoding="utf-8"))


def executed(notebook: Any, folder: Path) -> Any:
    """The notebook with its outputs, from a kernel of this interpreter and this checkout, in an empty folder.

    The kernel `python3` of a machine may belong to another environment, so the kernel is described here.
    """
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
    pytest.importorskip("ipykernel", reason="ipykernel is not installed")
    import nbformat  # nbclient needs this and the next
    from jupyter_client.kernelspec import KernelSpecManager
    from jupyter_client.manager import AsyncKernelManager

    described, work = folder / "kernels" / "here", folder / "work"
    described.mkdir(parents=True)
    work.mkdir()
    spec = {
        "argv": [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}"],
        "display_name": "here",
        "language": "python",
        "env": {"PYTHONPATH": str(ROOT), "IPYTHONDIR": str(folder / "ipython"), "TMPDIR": str(work)},
    }
    (described / "kernel.json").write_text(json.dumps(spec))
    kernel = AsyncKernelManager(
        kernel_name="here",
        kernel_spec_manager=KernelSpecManager(kernel_dirs=[str(described.parent)]),
        connection_file=str(folder / "connection.json"),
    )
    parsed = nbformat.reads(json.dumps(notebook), as_version=4)
    nbformat.validate(parsed)
    resources = {"metadata": {"path": str(work)}}
    return nbclient.NotebookClient(parsed, km=kernel, resources=resources, **PATIENCE).execute()


def one_cell(code: str) -> dict[str, Any]:
    cell = {"cell_type": "code", "id": "a", "execution_count": None, "metadata": {}, "outputs": [], "source": code}
    return {"cells": [cell], "metadata": {}, "nbformat": 4, "nbformat_minor": 5}


def test_there_are_two() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["first_clip", "uncertainty"]


@pytest.mark.paper
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path) -> None:
    """Its cells assert its claims."""
    pytest.importorskip("pandas", reason="pandas is not installed")
    notebook = read(path)
    assert any("\nassert " in "\n" + "".join(cell["source"]) for cell in notebook["cells"])
    done = executed(notebook, tmp_path)
    shown = {kind for cell in done.cells for output in cell.get("outputs", ()) for kind in output.get("data", {})}
    assert "image/png" in shown


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_functions_a_notebook_calls_exist(path: Path) -> None:
    cells = [cell for cell in read(path)["cells"] if cell["cell_type"] == "code"]
    nodes = [node for cell in cells for node in ast.walk(ast.parse("".join(cell["source"])))]
    asked = {n.attr for n in nodes if isinstance(n, ast.Attribute) and getattr(n.value, "id", "") == "km"}
    assert len(asked) > 4
    assert [name for name in sorted(asked) if not hasattr(km, name)] == []


@pytest.mark.paper
def test_a_kernel_uses_this_interpreter_and_checkout(tmp_path: Path) -> None:
    done = executed(
        one_cell("import os, sys, kinemode\nprint([sys.executable, kinemode.__file__, os.getcwd()])"), tmp_path
    )
    printed = done.cells[0].outputs[0].text
    assert printed.strip() == str([sys.executable, str(ROOT / "kinemode" / "__init__.py"), str(tmp_path / "work")])


@pytest.mark.paper
def test_a_cell_that_raises_fails(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="AssertionError"):
        executed(one_cell("assert 1 + 1 == 3"), tmp_path)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_without_outputs_and_its_links_lead_somewhere(path: Path) -> None:
    notebook = read(path)
    for cell in notebook["cells"]:
        assert not cell.get("outputs")
        assert cell.get("execution_count") is None
    assert notebook["metadata"]["kernelspec"]["name"] == "python3"  # the usual name in every environment
    text = "".join("".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "markdown")
    links = LINK.findall(text)
    assert links
    for link in links:
        assert (FOLDER / link.partition("#")[0]).is_file(), link
