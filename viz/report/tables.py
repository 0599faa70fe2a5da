"""The tables and lists of a report as HTML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape

import numpy as np

from estimator.data.cameras.camera import Camera
from estimator.runs.gait import METHODS, Gait
from estimator.runs.keypoint_residuals import KeypointResiduals, MarkerResiduals
from estimator.runs.ranges import RangeOfMotion
from viz.page_style import text
from viz.report.pictures import Facts

_SIGN = "\N{MINUS SIGN}"
_UNKNOWN = "\N{EN DASH}"
_GIVEN = "given"


def ranges_table(ranges: Sequence[RangeOfMotion], *, intervals: bool = True) -> str:
    """One row a joint: least, greatest, range, each with its interval if requested, in degrees, or millimetres where it
    slides."""
    if not intervals:
        rows = [
            (_shown(r), *(_united(value, r.slides) for value in (r.least.value, r.greatest.value, r.range)))
            for r in ranges
        ]
        return table(("joint", "least", "greatest", "range"), rows, numbers=3)
    head = "".join(f'<th class="n">{name}</th><th class="i">90 %</th>' for name in ("least", "greatest", "range"))
    lines = (
        f"<tr><td>{escape(_shown(r))}</td>"
        + _valued(r.least.value, r.least.low, r.least.high, r.slides)
        + _valued(r.greatest.value, r.greatest.low, r.greatest.high, r.slides)
        + _valued(r.range, r.range_low, r.range_high, r.slides)
        + "</tr>"
        for r in ranges
    )
    return f'<table class="full"><thead><tr><th>joint</th>{head}</tr></thead><tbody>\n{_lines(lines)}\n</tbody></table>'


def _shown(r: RangeOfMotion) -> str:
    return r.joint if r.seen else f"{r.joint} (not seen)"


def _lines(rows: Iterable[str]) -> str:
    return "\n".join(rows)


def number(value: float, slides: bool) -> str:
    """An angle [rad] in degrees, or a length [m] in millimetres, to a tenth."""
    shown = round((1e3 if slides else 180.0 / np.pi) * value, 1) + 0.0
    return f"{shown:.1f}".replace("-", _SIGN) if np.isfinite(shown) else _UNKNOWN


def _united(value: float, slides: bool) -> str:
    return number(value, slides) + (" mm" if slides else "\N{DEGREE SIGN}")


def _valued(value: float, low: float, high: float, slides: bool) -> str:
    """The two cells of a value and its interval."""
    known = bool(np.isfinite([low, high]).all())
    interval = f"{number(low, slides)} to {number(high, slides)}" if known else "not known"
    return f'<td class="n">{_united(value, slides)}</td><td class="i">{interval}</td>'


def table(
    head: Sequence[str], rows: Iterable[Sequence[str]], kind: str = "", *, numbers: int = 0, paths: Sequence[int] = ()
) -> str:
    """A table of texts. numbers: how many columns at the right end have numbers. paths: those that may be broken
    anywhere."""
    first = len(head) - numbers

    def cell(tag: str, k: int, said: str) -> str:
        name = "n" if k >= first else "path" if k in paths and tag == "td" else ""
        of_kind = f' class="{name}"' if name else ""
        return f"<{tag}{of_kind}>{escape(said)}</{tag}>"

    body = _lines(f"<tr>{''.join(cell('td', k, said) for k, said in enumerate(row))}</tr>" for row in rows)
    top = "".join(cell("th", k, said) for k, said in enumerate(head))
    of_kind = f' class="{kind}"' if kind else ""
    return f"<table{of_kind}><thead><tr>{top}</tr></thead><tbody>\n{body}\n</tbody></table>"


def listed(sentences: Sequence[str]) -> str:
    """Sentences as a list."""
    return f'<ul class="plain">{"".join(f"<li>{text(_sentence(s))}</li>" for s in sentences)}</ul>'


def _sentence(said: str) -> str:
    said = said.strip()
    return said[:1].upper() + said[1:] + ("" if said.endswith((".", "!", "?")) else ".")


_STRIDE_HEAD = (
    "foot", "strikes [s]", "leaves [s]", "strikes [s]", "length [m]", "width [m]", "speed [m/s]", "steps/min",
    "stance [%]", "flight [%]",
)  # fmt: skip


def _known(value: float) -> str:
    """Dash: the speed of a treadmill is not known."""
    return "-" if np.isnan(value) else f"{value:.2f}"


def gait_part(gait: Gait) -> str:
    """Strides, one row each, and the source of their events; or why there are none."""
    parts = ["<h3>Strides</h3>"]
    rows = [
        (
            s.side, f"{s.start:.2f}", f"{s.off:.2f}", f"{s.end:.2f}", _known(s.length), f"{s.width:.2f}",
            _known(s.speed), f"{s.cadence:.0f}", f"{s.stance:.0f}", f"{s.flight:.0f}",
        )
        for s in gait.strides
    ]  # fmt: skip
    if rows:
        parts.append(f'<div class="scroll">{table(_STRIDE_HEAD, rows, numbers=len(_STRIDE_HEAD) - 1)}</div>')
        parts.append(f"<p class='muted'>From a strike of the foot to its next, by {escape(METHODS[gait.method])}.</p>")
    if gait.belt is not None and np.isfinite(gait.belt):
        parts.append(f"<p>Treadmill: lengths and speeds are along a belt that moves at {gait.belt:.2f} m/s.</p>")
    if gait.remark:
        parts.append(f"<p>{text(_sentence(gait.remark if rows else 'none: ' + gait.remark))}</p>")
    return "\n".join(parts)


_CAMERA_HEAD = ("camera", "turn \N{PLUS-MINUS SIGN}", "place \N{PLUS-MINUS SIGN}", "focal length [px]", "error [px]")


def cameras_table(cameras: Sequence[Camera], errors: Mapping[str, float]) -> str:
    """One row a camera: deviations of its placement and its focal length, and its error [px]."""
    rows = []
    for camera in cameras:
        turn, place = number(camera.turn_std, False), number(camera.place_std, True)
        sure = [_GIVEN, _GIVEN] if camera.deviations is None else [f"{turn}\N{DEGREE SIGN}", f"{place} mm"]
        std = f" \N{PLUS-MINUS SIGN} {camera.focal_std:.0%}" if camera.focal_std > 0.0 else f", {_GIVEN}"
        focal = _UNKNOWN if camera.parallel else f"{camera.K[0, 0]:.0f}{std}"
        error = f"{errors[camera.name]:.1f}" if camera.name in errors else _UNKNOWN
        rows.append((camera.name, *sure, focal, error))
    return table(_CAMERA_HEAD, rows, numbers=len(_CAMERA_HEAD) - 1)


_KEYPOINT_HEAD = ("keypoint", "px", "mm", "off the landmark [mm]", "\N{PLUS-MINUS SIGN} [mm]")


def keypoints_part(residuals: KeypointResiduals | None) -> str:
    """The section of keypoints: how well each camera's fit, and where the detector marks each landmark; nothing without
    keypoints."""
    if residuals is None:
        return ""
    pixels, metres = residuals.overall
    said = (
        f"Keypoints fit by {pixels:.1f} px, {number(metres, True)} mm at the person: the median distance from where the"
        " body has them. Noise: what the camera's detector errs, as a factor of what is expected of one; measured where"
        " a person was fitted to several cameras, or given. Off the landmark: how far from it the detector marks it on"
        " this person, in all frames alike, and how unsure that is along each axis."
    )
    of_cameras = [
        (*_fitting(name, *own), f"{noise:.2f}")
        for name, own, noise in zip(residuals.cameras, residuals.of_cameras, residuals.noise, strict=True)
    ]
    places = residuals.places
    of_landmarks = [
        (*_fitting(name, *own), number(float(apart), True), number(float(std), True))
        for name, own, apart, std in zip(places.names, residuals.of_landmarks, places.apart, places.std, strict=True)
        if np.isfinite(own).all()
    ]
    parts = [
        f'<p class="muted">{escape(said)}</p>', table(("camera", "px", "mm", "noise"), of_cameras, numbers=3),
        f'<div class="scroll">{table(_KEYPOINT_HEAD, of_landmarks, numbers=4)}</div>',
    ]  # fmt: skip
    return '<section id="keypoints"><h2>Keypoints</h2>\n' + "\n".join(parts) + "\n</section>"


def _fitting(name: str, pixels: float, metres: float) -> tuple[str, str, str]:
    return name, f"{pixels:.1f}" if np.isfinite(pixels) else _UNKNOWN, number(metres, True)


def markers_part(residuals: MarkerResiduals | None) -> str:
    """The section of markers: one row each, those that lie farthest from the body first; nothing without markers."""
    if residuals is None:
        return ""
    order = np.argsort(-np.nan_to_num(residuals.rms, nan=-1.0), kind="stable")
    of_each = [residuals.rms, residuals.median, residuals.std]
    rows = [
        (
            residuals.names[m],
            *(number(float(part[m]), True) for part in of_each),
            *(_percent(part[m]) for part in (residuals.outlying, residuals.missing)),
        )
        for m in order.tolist()
    ]
    whole = float(np.sqrt(np.nanmean(np.square(residuals.apart))))
    said = (
        f"Distance of what was measured from the marker's place on the body; {number(whole, True)} mm root mean square"
        " of all. Expected: deviation along each axis, of the measurement and of what counts of the place's. Outlying:"
        " farther than three of these."
    )
    head = ("marker", "RMS [mm]", "median [mm]", "expected [mm]", "outlying", "missing")
    parts = [f'<p class="muted">{escape(said)}</p>', f'<div class="scroll">{table(head, rows, numbers=5)}</div>']
    return '<section id="markers"><h2>Markers</h2>\n' + "\n".join(parts) + "\n</section>"


def _percent(share: float) -> str:
    return f"{share:.1%}" if np.isfinite(share) else _UNKNOWN


def motion_part(rows: Sequence[tuple[str, str]]) -> str:
    """The section with the figures of a motion that was made from another; nothing without any."""
    if not rows:
        return ""
    said = (
        "The motion against what it was made from and against what holds for the body: limits of its URDF, parts that"
        " collide, the floor at z = 0, and feet that stand where the source's do."
    )
    parts = [f'<p class="muted">{escape(said)}</p>', f'<div class="scroll">{table(("what", "figure"), rows)}</div>']
    return '<section id="motion"><h2>How it follows</h2>\n' + "\n".join(parts) + "\n</section>"


def assumed_part(facts: Facts) -> str:
    """Contradictions with subject or input, unmeasured values, and the fitted lengths."""
    parts = []
    if facts.findings:
        parts += ["<h3>What contradicts the subject or the input</h3>", listed(facts.findings)]
        parts.append("<h3>Not measured</h3>")
    parts.append(listed(facts.assumed) if facts.assumed else "<p>Nothing that the run knows of.</p>")
    if facts.lengths:
        rows = [(name, f"{scale:.3f}") for name, scale in facts.lengths]
        parts += ["<h3>Fitted lengths, as multiples of the subject's own</h3>"]
        parts.append(table(("up to the joint", "scale"), rows, numbers=1))
    return "\n".join(parts)


def repeat_part(facts: Facts) -> str:
    """The command, the settings that differ, files with their digests, versions."""
    parts = [f"<pre>{escape(facts.command)}</pre>"] if facts.command else []
    if facts.blanks:
        parts.append(f"<p class='muted'>{escape(facts.blanks)}</p>")
    usual = "those by default" if facts.motion else "the tracker's own"
    parts.append(f"<h3>Settings that differ from {usual}</h3>")
    parts.append(table(("setting", "here", "by default"), facts.settings) if facts.settings else "<p>None.</p>")
    if facts.files:
        parts.append("<h3>Files, with their SHA-256 as they are now</h3>")
        parts.append(f'<div class="scroll">{table(("what", "file", "SHA-256"), facts.files, paths=(1, 2))}</div>')
    parts += ["<h3>Versions</h3>", table(("program", "version"), facts.versions)]
    return "\n".join(parts)
