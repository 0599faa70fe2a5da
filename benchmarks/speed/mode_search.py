"""One mode search beside scipy's `least_squares(method='trf', bounds=...)`: the same energy of a frame, equal starts.

Both sides descend the keypoints' robust energy with stabilisers and the root's tilt, within the joint limits. Scipy
gets it as a sum of squares with the exact Jacobian (`benchmarks.speed.mode_search_residuals`). Ours runs until its KKT
residual is below 1e-6, scipy until it is as low as ours came, or to its own end where it never is. Both sides of a
start run one after the other in one process, and CPU time counts, so that a busy machine slows both.

The starts are those that the tracker searches from (`benchmarks.speed.mode_search_starts`); their energy has the
transition from the frame before as well, on both sides, as the tracker's has. That decides how often both sides end in
the same minimum, since a frame alone has more of them: `--no-transition` leaves it out. The repulsion of body parts is
on neither side, since it is not a sum of squares. Random starts, from near to very far, have one frame's energy alone.

One camera leaves several minima, and which of them a descent from afar falls into is luck, on both sides. So it is also
counted how low ours comes with as many searches, from the start and from poses around it, as fit into a tenth of the
time that scipy takes for its one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Annotated, Any, Literal

import numpy as np

from benchmarks.speed.mode_search_duel import Contest, Duel, no_higher
from benchmarks.speed.mode_search_starts import KINDS, subsample, tracker_starts
from benchmarks.support.common import Json, Several, save
from kinemode.terminal import report

TARGET, SHARE = 10.0, 0.95
DISTANCES = (0.05, 0.1, 0.2, 0.3, 0.5)  # standard deviation of every joint between truth and start [rad], root [rad, m]


def main(
    *,
    starts: Literal["tracker", "random"] = "tracker",
    count: int = 500,
    transition: bool = True,
    seed: int = 0,
    distances: Annotated[tuple[float, ...], Several] = DISTANCES,
    json: Json = None,
) -> None:
    """Search from equal starts with ours and with scipy.

    Parameters
    ----------
    starts
        Those that the tracker searches from, or random ones.
    count
        Starts: drawn evenly from the tracker's, or shared out among the distances.
    transition
        Whether the change since the previous frame is penalised, from the tracker's starts.
    seed
        Of poses, keypoints and starts.
    distances
        Random starts, from truth to start: standard deviation of every joint and of the root's turn [rad] and place
        [m].
    """
    contest, rng = Contest(), np.random.default_rng(seed)
    contest.duel(contest.random_start(0.1, np.random.default_rng(seed)), np.random.default_rng(seed))  # compiles
    if starts == "tracker":
        kinds: Sequence[str] = KINDS
        contest_starts = subsample(tracker_starts(seed), count, rng)
        contest_starts = contest_starts if transition else [replace(start, q_previous=None) for start in contest_starts]
    else:
        kinds = [f"{d:g}" for d in distances]
        contest_starts = [contest.random_start(distances[i % len(distances)], rng) for i in range(count)]
    duels = [contest.duel(start, rng) for start in contest_starts]
    by_kind = {kind: figures(group) for kind in kinds if (group := [d for d in duels if d.kind == kind])}
    by_kind["all"] = figures(duels)
    show(by_kind, "start" if starts == "tracker" else "start off by")
    figure = {
        "measure": "mode search",
        "target": TARGET,
        "starts": starts,
        "transition": transition,
        "by_kind": by_kind,
    }
    save(json, figure | {"duels": [asdict(d) for d in duels]})


def figures(duels: Sequence[Duel]) -> dict[str, float]:
    """Medians, totals and shares of some starts."""
    ours, theirs, full, inside = (np.array([getattr(d, n) for d in duels])
                                  for n in ("our_ms", "their_ms", "full_ms", "residual_ms"))  # fmt: skip
    return {
        "starts": len(duels),
        "our_ms": float(np.median(ours)),
        "their_ms": float(np.median(theirs)),
        "ratio": float(np.median(theirs) / np.median(ours)),
        "ratio_of_totals": float(theirs.sum() / ours.sum()),
        "ratio_to_the_end": float(full.sum() / ours.sum()),
        "ratio_without_residuals": float((full - inside).sum() / ours.sum()),
        "our_steps": float(np.median([d.our_steps for d in duels])),
        "their_steps": float(np.median([d.their_steps for d in duels])),
        "no_higher": float(np.mean([no_higher(d.ours, d.theirs) for d in duels])),
        "scipy_no_higher": float(np.mean([no_higher(d.theirs, d.ours) for d in duels])),
        "no_higher_in_a_tenth": float(np.mean([no_higher(d.in_a_tenth, d.theirs) for d in duels])),
        "converged": float(np.mean([d.converged for d in duels])),
    }


def show(by_kind: Mapping[str, Mapping[str, Any]], first: str) -> None:
    out = report.console()
    names = (
        "starts", "ours [ms]", "scipy [ms]", "ratio", "of totals", "to its end", "its solver alone", "steps", "scipy's",
        "equal or lower", "scipy's", "in 1/10 time", "KKT < 1e-6",
    )  # fmt: skip
    made = report.table("mode search, 34 degrees of freedom, one camera", first, *names)
    for name, f in by_kind.items():
        times = [f"{f['our_ms']:.2f}", f"{f['their_ms']:.1f}"]
        ratios = [f"{f[n]:.1f}" for n in ("ratio", "ratio_of_totals", "ratio_to_the_end", "ratio_without_residuals")]
        steps = [f"{f['our_steps']:.0f}", f"{f['their_steps']:.0f}"]
        shares = [f"{f[n]:.1%}" for n in ("no_higher", "scipy_no_higher", "no_higher_in_a_tenth", "converged")]
        made.add_row(name, f"{f['starts']}", *times, *ratios, *steps, *shares)
    out.width = max(out.width, 180)
    out.print(made)
    out.print(
        "[ms] and steps: medians. ratio: of the median times, of the totals; to its end: scipy's total until its own"
        " tolerances stop it; its solver alone: that without the time in residuals and Jacobian.\n"
        "equal or lower: starts from which ours ends no higher than scipy; scipy's: no higher than ours; in 1/10 time:"
        " the best of our searches, the first from the start, the others from around it, in a tenth of scipy's time.\n"
        f"targets: {TARGET:g} times faster, equal or lower in {SHARE:.0%} of the starts"
    )
