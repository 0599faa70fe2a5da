"""A run as one page to read, print and send on: it needs no network and no other file."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template

from estimator.runs.contact import contact_of_run
from estimator.runs.forces import Forces
from estimator.runs.gait import gait_if_whole
from estimator.runs.ranges import ranges_of_motion
from estimator.runs.run_reader import Run
from estimator.trackers.frame_result import HARD, STATUS_MEANINGS
from humanoid.support.files import replacing
from viz.page_style import page_style, text
from viz.pictures.overlay import Progress
from viz.report import pictures
from viz.report.pictures import COLOURS, Facts, Figure, angle_figures, contact_figure, forces_figure
from viz.report.tables import (
    assumed_part,
    cameras_table,
    gait_part,
    keypoints_part,
    markers_part,
    motion_part,
    ranges_table,
    repeat_part,
)  # fmt: skip
from viz.scene import Scene, pictured_scene

_TRACKED_RANGES = (
    "The least and the greatest value of each joint, and the range between them; beside each the interval in which it"
    " lies with a probability of 90&nbsp;%. Intervals are calibrated and count all hypotheses; that of a range takes"
    " the errors of its two ends as independent. Frames in which nothing was seen do not count."
)
_MADE_RANGES = "The least and the greatest value of each joint, and the range between them."
_BESIDE = (
    "Sticks: the source, moved aside. Solid: the subject. Discs: where the source's feet stand, and the subject's are"
    " to."
)
_MADE_HARD = (
    "a stance, a clearance or the floor is missed by over 2 mm: the solver came no nearer, as the source demands more"
    " than the body can do, or moves faster"
)
_TEMPLATE = Path(__file__).with_name("report.html")


def write_report(
    run: Run,
    path: str | Path,
    facts: Facts,
    *,
    figures: Sequence[Figure] | None = None,
    forces: Forces | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write the page and return its path. The file is written whole or not at all.

    facts: what is reported beside the motion. figures: the joint angles over time, by default those of `angle_figures`.
    forces: of the run, drawn below when the feet stand. progress: called with (frames of the film drawn, all frames).
    Raises InputError for a run without a tracked frame, or a file that cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_text(page(run, facts, figures=figures, forces=forces, progress=progress), encoding="utf-8")
    return Path(path)


def page(
    run: Run,
    facts: Facts,
    *,
    figures: Sequence[Figure] | None = None,
    forces: Forces | None = None,
    progress: Progress | None = None,
) -> str:
    """The text of the page, see `write_report`."""
    scene = pictured_scene(run)
    source = _source(run)
    drawings = angle_figures(run) if figures is None else figures
    return Template(_TEMPLATE.read_text(encoding="utf-8")).substitute(
        title=escape(f"{source} - kinemode report"),
        style=page_style(),
        heading=escape(source),
        summary=escape(_summary(run)),
        tags=_tags(run, facts),
        film=_film(run, scene, progress),
        to_motion='<a href="#motion">How it follows</a>' if facts.motion else "",
        motion=motion_part(facts.motion),
        key=_key(run) if figures is None else "",
        curves=_curves(drawings),
        feet=_feet(run) + ("" if forces is None else forces_part(forces)),
        ranges=ranges_table(ranges_of_motion(run), intervals=not run.header.retargeted),
        ranges_key=_MADE_RANGES if run.header.retargeted else _TRACKED_RANGES,
        untrusted=_untrusted(run, scene),
        cameras=_cameras(run, facts) + keypoints_part(facts.keypoints) + markers_part(facts.markers),
        to_cameras=('<a href="#cameras">Cameras</a>' if len(run.header.cameras) > 1 else "")
        + ('<a href="#keypoints">Keypoints</a>' if facts.keypoints is not None else "")
        + ('<a href="#markers">Markers</a>' if facts.markers is not None else ""),
        assumed=assumed_part(facts),
        repeat=repeat_part(facts),
    )


def _source(run: Run) -> str:
    """Title of the run: its clips' names, else its own."""
    clips = [Path(clip).name for clip in (*run.header.clips.values(), *run.header.points) if clip]
    return ", ".join(clips) or run.file.name


def _summary(run: Run) -> str:
    header = run.header
    seconds = float(run.time[-1] - run.time[0])
    frames = f"{len(run)} frames" + ("" if run.complete else f" of {run.planned_count}, not finished")
    when = f"{frames}, {run.time[0]:.2f} to {run.time[-1]:.2f} s ({seconds:.2f} s)"
    who = f"subject {run.subject.name}, {run.body.nv} degrees of freedom"
    if header.retargeted:
        return f"{when}; {who}; made from {_source(run)}"
    cameras = [f"{c.name} ({c.image_size[0]} x {c.image_size[1]})" for c in header.cameras]
    several = "cameras" if len(cameras) > 1 else "camera"
    seen_by = f"{several} {', '.join(cameras)}" if cameras else "no camera"
    return (
        f"{when}; {seen_by}; {who}; tracker {header.tracker}, up to {run.hypothesis_count} hypotheses a frame;"
        f" {_used_cues(run)}"
    )


def _used_cues(run: Run) -> str:
    keypoints = bool((run.confidence > 0.0).any()) if len(run.confidence) else False
    looked = (["keypoints"] if keypoints else []) + list(run.header.cues)
    looked += [f"{len(run.body.marker_names)} markers"] if run.header.points else []
    return "input used: " + (", ".join(looked) or "nothing")


def _tags(run: Run, facts: Facts) -> str:
    counts = Counter(run.status.tolist())
    tags = [(f"{count} {status}", status != "tracked") for status, count in counts.most_common()]
    if not run.complete:
        tags.append(("not finished", True))
    if facts.findings:
        tags.append((f"{len(facts.findings)} doubt{'s' if len(facts.findings) > 1 else ''} of subject or input", True))
    return "".join(f"<li{' class=warn' if warn else ''}>{escape(said)}</li>" for said, warn in tags)


def _film(run: Run, scene: Scene, progress: Progress | None) -> str:
    parts = []
    without = pictures.without_picture(scene)
    gone = [name for name in without if run.header.clips.get(name) is not None]
    never = [name for name in without if name not in gone]
    for names, what in (
        (gone, "is not where it was when it was tracked"),
        (never, "was not given, only its keypoints"),
    ):
        if names and run.header.cameras:
            clip = f"The clip of {', '.join(names)} {what}: the body is drawn on an empty ground."
            parts.append(f"<p>{escape(clip)}</p>")
    if scene.source is not None:
        parts.append(f'<p class="muted">{_BESIDE}</p>')
    middle = next(t for t in sorted(range(len(scene)), key=lambda t: abs(t - len(scene) // 2)) if scene.has_body(t))
    poster = _uri("image/jpeg", pictures.stills_of(scene, [middle])[0])
    data = pictures.film(scene, progress)
    if data is None:
        parts.append("<p>The clip is too long for a film in a page: <code>kinemode overlay</code> writes it.</p>")
    else:
        film = _uri("video/mp4", data)
        parts.append(
            f'<video controls muted loop playsinline preload="metadata" poster="{poster}" src="{film}"></video>'
        )
    kind = "poster" if data is None else "poster printed"
    parts.append(f'<img class="{kind}" src="{poster}" alt="frame {scene.index[middle]} with the body drawn over it">')
    return "\n".join(parts)


def _key(run: Run) -> str:
    sides = [side for side in ("left", "right") if any(name.startswith(side + "_") for name in run.body.q_names)]
    swatches = "".join(f'<span><i style="background:{COLOURS[side]}"></i>{side}</span>' for side in sides)
    lines = "line, best hypothesis; band, 90&nbsp;%; thin, other hypotheses"
    if run.header.retargeted:
        lines = "line, the motion"
    return (
        f"Degrees over seconds (metres where a joint slides), positive as the subject's axes have it: {lines}; dashed,"
        f" limits; yellow and hatched, frames not to be trusted. {swatches}"
    )


def _curves(figures: Sequence[Figure]) -> str:
    if not figures:
        return "<p>The subject has no joint of one degree of freedom.</p>"
    return f'<div class="curves">{_shown(figures)}</div>'


def _feet(run: Run) -> str:
    contact = contact_of_run(run)
    if contact is None:
        return "<p>The subject has no feet.</p>"
    gait = gait_if_whole(run, contact)
    drawn = _shown([contact_figure(contact, gait.events if gait else ())])
    return drawn if gait is None else f"{drawn}\n{gait_part(gait)}"


def forces_part(forces: Forces) -> str:
    """What the feet carry and the moments of the legs, and what they rest on."""
    key = (
        "On each foot upwards, forwards as the pelvis faces, and to the left, in percent of the weight, then joint"
        " moments; shaded, 90&nbsp;%."
        f" Mass {forces.mass.kilograms:.1f} kg ({escape(forces.mass.source)}). With both feet on the ground how they"
        " share the forces is determined in part."
    )
    remark = f"<p>{text(forces.remark)}</p>" if forces.remark else ""
    return f'\n<h3>Forces</h3>\n<p class="muted">{key}</p>\n{_shown([forces_figure(forces)])}{remark}'


def _shown(figures: Sequence[Figure]) -> str:
    return "".join(f'<figure><img src="{_uri(f.kind, f.data)}" alt="{escape(f.title)}"></figure>' for f in figures)


def _untrusted(run: Run, scene: Scene) -> str:
    spans, more = pictures.untrusted(scene, run.energy)
    if not spans and not more:
        return "<p>None: every frame is tracked.</p>"
    known = {**STATUS_MEANINGS, HARD: _MADE_HARD} if run.header.retargeted else STATUS_MEANINGS
    meanings = [f"<b>{escape(s)}</b>: {text(known[s])}." for s in dict.fromkeys(span.status for span in spans)]
    wide = " wide" if len(scene.cameras) > 1 else ""
    parts = [*(f"<p>{meaning}</p>" for meaning in meanings), f'<div class="stills{wide}">']
    parts += [_still(scene, span) for span in spans]
    parts.append("</div>")
    if more:
        parts.append(f"<p>{more} more, shorter than these, are marked in the curves above.</p>")
    return "\n".join(parts)


def _still(scene: Scene, span: pictures.Span) -> str:
    first, last = scene.index[span.first], scene.index[span.last]
    frames = f"frame {first}" if span.count == 1 else f"frames {first} to {last}"
    times = f"{scene.time[span.first]:.2f} s"
    if span.count > 1:
        times = f"{scene.time[span.first]:.2f} to {scene.time[span.last]:.2f} s; shown: frame {scene.index[span.shown]}"
    picture = _uri("image/jpeg", span.picture)
    caption = f"<figcaption><b>{escape(span.status)}</b> {frames}, {times}</figcaption>"
    return f'<figure><img src="{picture}" alt="{escape(span.status)}, {frames}">{caption}</figure>'


def _cameras(run: Run, facts: Facts) -> str:
    """The section of a run of several cameras, nothing of a single one."""
    cameras = run.header.cameras
    if len(cameras) < 2:
        return ""
    key = (
        "From above: fields of view, and the person's path; discs, deviations of places, to scale."
        " Turn and place: root mean square deviations; error: keypoints from the landmarks of the body, root mean"
        " square without outliers."
    )
    parts = [f'<p class="muted">{escape(key)}</p>', _shown([pictures.rig_figure(run)])]
    parts.append(f'<div class="scroll">{cameras_table(cameras, facts.errors)}</div>')
    return '<section id="cameras"><h2>Cameras</h2>\n' + "\n".join(parts) + "\n</section>"


def _uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
