"""The reference pages, written from the code: commands, settings, file formats, trackers, the public interface.

Each page of docs/reference is an introduction, to which `docs/conf.py` adds what the function of its name in `PAGES`
returns. `python docs/generate.py NAME` prints one of them.
"""

from __future__ import annotations

import ast
import importlib.util
import inspect
import re
import sys
import textwrap
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent

KEYPOINTS = {
    "kinemode's JSON": "keypoints_own",
    "OpenPose and AlphaPose": "keypoints_openpose",
    "MMPose and rtmlib": "keypoints_mmpose",
    "DeepLabCut": "keypoints_deeplabcut",
    "SLEAP analysis h5": "keypoints_sleap",
    "COCO data sets": "keypoints_coco",
    "Ultralytics YOLO pose": "keypoints_ultralytics",
    "npy and npz": "keypoints_npy",
    "Names of keypoints": "keypoints_names",
}
CAMERAS = {
    "kinemode's JSON": "cameras_json",
    "Pose2Sim, Anipose and Caliscope": "cameras_toml",
    "OpenCV and ROS": "cameras_opencv",
    "Kalibr": "cameras_kalibr",
    "EasyMocap": "cameras_easymocap",
    "CMU Panoptic": "cameras_panoptic",
    "Qualisys": "cameras_qualisys",
}

_ITEM = re.compile(r"[A-Za-z_][\w.]*(?:, [A-Za-z_][\w.]*)*(?: ?[(\[][^:]*[)\]])*(?: bool| text)?: ")
_SPLIT = re.compile(r"(`[^`]*`)")


# -- docstrings as Markdown ---------------------------------------------------


def markdown(text: str) -> str:
    """A docstring as Markdown: underlined sections become bold words, `name: text` list items, indented text and
    programs blocks of code."""
    paragraphs = inspect.cleandoc(text).split("\n\n")
    return "\n\n".join(_paragraph(lines.splitlines(), first=i == 0) for i, lines in enumerate(paragraphs))


def _paragraph(lines: list[str], first: bool) -> str:
    if len(lines) > 1 and set(lines[1]) == {"-"}:
        return f"**{lines[0]}**\n\n{_paragraph(lines[2:], first=False)}"
    if lines[0].startswith(">>> "):
        return "\n".join(["```pycon", *lines, "```"])
    outer = [line for line in lines if not line.startswith("    ")]
    if not outer or (not first and len(outer) < len(lines) and not all(_ITEM.match(line) for line in outer)):
        return "\n".join(["```text", *textwrap.dedent("\n".join(lines)).splitlines(), "```"])
    if first or not _ITEM.match(lines[0]):
        return "\n".join(escaped(line) for line in lines)
    return "\n".join(_item(line) for line in lines)


def _item(line: str) -> str:
    """A line of a list: a new item where it begins with names, else more of the one before."""
    name, _, rest = line.partition(": ")
    return f"- `{name}`: {escaped(rest)}" if _ITEM.match(line) else f"  {escaped(line.strip())}"


def escaped(text: str) -> str:
    """Text in which only code between backticks is Markdown."""
    parts = _SPLIT.split(text)
    return "".join(part if part.startswith("`") else re.sub(r"([*<\[\]|])", r"\\\1", part) for part in parts)


def docstring(module: str) -> str:
    """The docstring of a module, which is not imported."""
    spec = importlib.util.find_spec(module)
    assert spec is not None, module
    assert spec.origin is not None, module
    return ast.get_docstring(ast.parse(Path(spec.origin).read_text(encoding="utf-8"))) or ""


# -- the pages ----------------------------------------------------------------


def commands() -> str:
    """Every command with its arguments and options, from the command line itself."""
    from kinemode.cli import app

    arguments, sys.argv = sys.argv, ["kinemode"]  # by which the usage lines call the program
    try:
        page = app.generate_docs(output_format="markdown")
    finally:
        sys.argv = arguments
    first = page.index("\n## ", page.index("**Commands**"))
    text = re.sub(r"^```console$", "```text", page[first:], flags=re.MULTILINE)
    text = re.sub(r"^Example: (kinemode .*)$", r"Example:\n\n\1", text, flags=re.MULTILINE)
    text = re.sub(r"\[default: \('([^']*)',\)\]", r"[default: \1]", text)  # a tuple of one
    return re.sub(r"(?<!```text\n)^(kinemode .*)$", r"    \1", text, flags=re.MULTILINE)  # the usage is code already


def settings() -> str:
    """The settings file of the default tracker, then what the other trackers have of their own and set otherwise."""
    from estimator.tracking.registry import DEFAULT, TRACKERS, settings_for
    from kinemode.settings import describe_settings

    common = settings_for(DEFAULT).to_dict()
    parts = ["## Common settings", *_tables(describe_settings(DEFAULT), lambda table: table != TRACKERS[DEFAULT].group)]
    seen: set[str] = set()
    for spec in TRACKERS.values():
        parts.append(f"## {spec.name}\n\n{escaped(spec.sentence[0].upper() + spec.sentence[1:])}.")
        if not spec.group:
            parts.append("It has no settings of its own.")
        elif spec.group in seen:
            first = next(other.name for other in TRACKERS.values() if other.group == spec.group)
            parts.append(f"Its own settings are those of [{first}](#{first}), with these values:")
            own = _flat({spec.group: settings_for(spec.name).to_dict()[spec.group]})
            others = _flat({spec.group: settings_for(first).to_dict()[spec.group]})
            parts.append(_listed({name: value for name, value in own.items() if others[name] != value}))
        else:
            seen.add(spec.group)
            parts += _tables(describe_settings(spec.name), lambda table, own=spec.group: table == own)
        changes = _flat({name: values for name, values in settings_for(spec.name).to_dict().items() if name in common})
        usual = _flat(common)
        differing = {k: v for k, v in changes.items() if k in usual and usual[k] != v and not k.startswith(spec.group)}
        if differing:
            parts += ["Common settings that have other values for it:", _listed(differing)]
    return "\n\n".join(parts)


def _tables(text: str, wanted: Callable[[str], bool]) -> list[str]:
    """The tables of a settings file whose group is wanted, each with a heading."""
    blocks = []
    for block in text.strip().split("\n\n"):
        head = re.search(r"^\[(.+)\]$", block, re.MULTILINE)
        if head is not None and wanted(head[1].partition(".")[0]):
            blocks.append(f"### `[{head[1]}]`\n\n```toml\n{block}\n```")
    return blocks


def _flat(values: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for name, value in values.items():
        flat.update(_flat(value, f"{before}{name}.") if isinstance(value, Mapping) else {before + name: value})
    return flat


def _listed(values: Mapping[str, Any]) -> str:
    written = {True: "true", False: "false"}
    shown = (f"{n} = {written[v] if isinstance(v, bool) else repr(v)}" for n, v in values.items())
    return "\n".join(f"- `{line}`" for line in shown) or "- none"


def trackers() -> str:
    """Every tracker with what it is, from the specifications that it registers."""
    from estimator.tracking.registry import DEFAULT, TRACKERS

    rows = ["| name | what it is | hypotheses | its settings |", "| --- | --- | --- | --- |"]
    for spec in TRACKERS.values():
        name = f"`{spec.name}`" + (" (the default)" if spec.name == DEFAULT else "")
        several = "several" if spec.keeps_several else "one"
        own = f"[`{spec.group}`](settings.md#{spec.name})" if spec.group else "none"
        rows.append(f"| {name} | {escaped(spec.sentence)} | {several} | {own} |")
    parts = ["\n".join(rows)]
    modules: dict[str, list[str]] = {}
    for spec in TRACKERS.values():
        modules.setdefault(_made_in(spec), []).append(spec.name)
    for module, names in modules.items():
        parts.append("## " + ", ".join(names) + f"\n\n{markdown(docstring(module))}\n\nSource: `{module}`.")
    return "\n\n".join(parts)


def _made_in(spec: Any) -> str:
    """The module that registers a tracker: the one in which its Spec stands."""
    from estimator.trackers.spec import Spec

    for name, module in sorted(sys.modules.items()):
        if name.startswith("estimator.trackers."):
            for value in vars(module).values():
                if value is spec or (isinstance(value, tuple) and any(v is spec for v in value if isinstance(v, Spec))):
                    return name
    raise AssertionError(spec.name)


def formats() -> str:
    """What is read and written, from the docstrings of the readers and the registries of the writers."""
    parts = ["## Keypoints", *_modules(KEYPOINTS), *_layouts(), "## Cameras", *_modules(CAMERAS)]
    parts += ["## Subjects", *_subjects(), "## Motions and references", *_motions(), "## Runs", *_runs()]
    return "\n\n".join(parts)


def _modules(titles: Mapping[str, str], package: str = "estimator.data.formats") -> list[str]:
    return [f"### {title}\n\n{markdown(docstring(f'{package}.{module}'))}" for title, module in titles.items()]


def _layouts() -> list[str]:
    from humanoid.subject.landmarks import FORMATS

    rows = [f"| `{name}` | {len(names)} |" for name, names in FORMATS.items()]
    return ["### Layouts", "\n".join(["| layout | keypoints |", "| --- | --- |", *rows])]


def _subjects() -> list[str]:
    titles = {"Elements of a URDF": "urdf_elements", "Landmark files": "landmark_file"}
    return _modules(titles, "humanoid.subject")


def _motions() -> list[str]:
    from estimator.data.formats.angle_files import read_motion_table
    from estimator.data.formats.reference import load_reference

    table, reference = (inspect.getdoc(what) or "" for what in (read_motion_table, load_reference))
    return [
        *_modules({"BVH": "bvh"}),
        *_modules({"csv and npy of points": "readers"}, "estimator.data.markers"),
        f"### csv and npz of joints\n\n{markdown(table.partition('Raises')[0])}",
        f"### References\n\n{markdown(reference.partition('Raises')[0])}",
    ]


def _runs() -> list[str]:
    import viz.exporters  # noqa: F401 - registers its own
    from estimator.runs.export import EXPORTERS, export_arrays

    names = ", ".join(f"`{name}`" for name in EXPORTERS)
    written = {"trc and mot": "opensim", "osim": "osim", "c3d": "c3d"}
    parts = [f"`kinemode export` writes {names}.", "### Run files", markdown(docstring("estimator.runs.run_store"))]
    parts += [f"### npz\n\n{markdown(inspect.getdoc(export_arrays) or '')}"]
    csv = inspect.getdoc(EXPORTERS["csv"].write) or ""
    parts += [f"### csv\n\n{escaped(csv)}" if csv else "", *_modules(written)]
    parts += _modules({"bvh": "bvh_skeleton"}, "estimator.runs")
    return [part for part in (*parts, *_modules({"glb": "gltf", "rrd": "rerun_file"}, "viz")) if part]


def interface() -> str:
    """Every public name with its signature and docstring."""
    import kinemode as km

    objects = {name: getattr(km, name) for name in km.__all__ if not name.startswith("_")}
    functions = {name: value for name, value in objects.items() if inspect.isfunction(value)}
    parts = ["## Functions", *(f"### `{name}`\n\n{_signature(f, name)}{_doc(f)}" for name, f in functions.items())]
    parts.append("## Classes")
    for name, value in objects.items():
        if name not in functions:
            parts.append(f"### `{name}`\n\n{_signature(value, name)}{_doc(value)}{_attributes(value)}")
    return "\n\n".join(parts)


def _doc(value: object) -> str:
    return markdown(inspect.getdoc(value) or "")


def _signature(value: Any, name: str) -> str:
    try:
        signature = inspect.signature(value)
    except ValueError:  # exceptions and warnings of the standard library's kind
        return ""
    said = {p.name: re.sub(r"^'|'$", "", str(p.annotation)) for p in signature.parameters.values()}
    lines, star = [], False
    for p in signature.parameters.values():
        if p.kind is p.KEYWORD_ONLY and not star:
            lines.append("*")
            star = True
        kind = "" if p.annotation is p.empty else f": {said[p.name]}"
        default = "" if p.default is p.empty else f" = {p.default!r}" if kind else f"={p.default!r}"
        lines.append(f"{p.name}{kind}{default}")
    one = f"{name}({', '.join(lines)})"
    many = f"{name}(\n" + "".join(f"    {line},\n" for line in lines) + ")"
    return f"```text\n{one if len(one) <= 100 else many}\n```\n\n"


def _attributes(kind: type) -> str:
    """The public methods and properties of a class, each with the first paragraph of its docstring."""
    rows = []
    for name, value in inspect.getmembers(kind):
        described = inspect.getdoc(value)
        if name.startswith("_") or name in dir(Exception) or not described:
            continue
        if not callable(value) and not _is_property(value):
            continue
        about = " ".join(described.partition("\n\n")[0].split())
        rows.append(f"- `{name}{'()' if callable(value) else ''}`: {escaped(about)}")
    return "\n\nMethods and properties:\n\n" + "\n".join(rows) if rows else ""


def _is_property(value: object) -> bool:
    return isinstance(value, property) or hasattr(value, "attrname")  # functools.cached_property has the latter


PAGES: dict[str, Callable[[], str]] = {
    "commands": cache(commands),
    "settings": cache(settings),
    "trackers": cache(trackers),
    "formats": cache(formats),
    "interface": cache(interface),
}
"""What is written below the introduction of docs/reference/NAME.md, by NAME."""


if __name__ == "__main__":
    print(PAGES[sys.argv[1]]())
