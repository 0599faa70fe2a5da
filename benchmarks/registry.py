"""The measures by name: what each one measures, its target, and the data and programs that it needs.

A measure is a module with a function `main`, whose arguments are the options of its command. This module imports none
of them, so that a list of all is quick.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module

from humanoid.support.errors import InputError, nearest

BEAM4CAM = "data: beam4cam"
MOCAP = "data: mocap"
MOCAP_MORE = "data: mocap_more"
OPENCAP = "data: opencap"
ASAP = "data: asap"
INDEX = "an index of examples (kinemode train-index)"
DETECTOR = "a detector (kinemode detect)"
CHROMIUM = "chromium"
EXTRA = "pip install -e .[benchmark]"
RUN = "a run of beam4cam with keypoints (kinemode track)"
ELMO_FIGURES = "figures that `elmo --json` wrote"
OPENSIM = "a Python that has opensim (--opensim-python)"
NOTHING = "nothing"
OURS = ("benchmarks", "humanoid", "estimator", "viz", "kinemode")
NEEDS = (
    BEAM4CAM,
    MOCAP,
    MOCAP_MORE,
    OPENCAP,
    ASAP,
    INDEX,
    DETECTOR,
    CHROMIUM,
    EXTRA,
    RUN,
    ELMO_FIGURES,
    OPENSIM,
    NOTHING,
)
"""The possible requirements of a measure."""


@dataclass(frozen=True)
class Measure:
    """A measure. module: dotted. summary: one sentence, what it measures or makes. target: what is aimed at, empty
    where nothing is. needs: some of NEEDS, without which it stops. uses: others, without which it measures less."""

    module: str
    summary: str
    target: str
    needs: tuple[str, ...]
    uses: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """By which it is run."""
        return self.module.rsplit(".", 1)[-1]

    @property
    def folder(self) -> str:
        """The package of its module."""
        return self.module.rsplit(".", 1)[0]

    def main(self) -> Callable[..., None]:
        """The function that measures; its module is imported now. Raises InputError where a library is missing."""
        try:
            function: Callable[..., None] = import_module(self.module).main
        except ModuleNotFoundError as error:
            if error.name is None or error.name.partition(".")[0] in OURS:
                raise
            raise InputError(self.name, f"{error.name} is not installed", remedy=EXTRA) from None
        return function


MEASURES = (
    # speed
    Measure(
        "benchmarks.speed.speed",
        "Speed of tracking from keypoints alone, where the time goes, and how far it is from kinematics alone.",
        ">= 30 frames/s",
        (NOTHING,),
        (BEAM4CAM,),
    ),
    Measure(
        "benchmarks.speed.realtime",
        "Frames per second with keypoints and pictures, in one process and in several, and where the time goes.",
        ">= 15 frames/s",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.speed.latency",
        "Time of a frame from its keypoints to its pose, frame by frame, as in live tracking.",
        "60 ms (95th percentile)",
        (NOTHING,),
        (BEAM4CAM,),
    ),
    Measure(
        "benchmarks.speed.step",
        "One constrained step of the 34-degree body on 17 landmarks beside `pink.solve_ik` on the same tasks.",
        "<= 0.20 of pink's time",
        (EXTRA,),
    ),
    Measure(
        "benchmarks.speed.solvers",
        "The constrained step by each of its solvers on whole tracks: whose steps they were, equal bits, and time.",
        "equal bits; <= 1.25 of the active set's time",
        (NOTHING,),
        (BEAM4CAM,),
    ),
    Measure(
        "benchmarks.speed.values",
        "Time saved by energies without derivatives: each term alone, and all particles of a frame.",
        "",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.speed.surface",
        "Time of the surface's image cost for one hypothesis over its floor: kinematics and one pass over the nodes.",
        "<= 1 ms",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.speed.self_collision",
        "Time of a self-collision query of human34 beside its kinematics, and which parts of the query take it.",
        "",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.speed.mode_search",
        "One mode search beside scipy's bounded least squares: the same energy of a frame, equal starts.",
        ">= 10 times as fast, energy equal or lower in >= 95 %",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.speed.loading",
        "Time to load chains of many joints, each in a process of its own; it must grow about linearly.",
        "400 joints < 2 s",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.speed.starting",
        "Processor time to import kinemode, to show help, and to report a missing file.",
        "< 0.5 s",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.speed.live_film",
        "Makes the film of the live view on the demonstration's clip that is in docs/pictures.",
        "",
        (CHROMIUM,),
    ),
    # accuracy
    Measure(
        "benchmarks.accuracy.sizes",
        "People of 0.9 to 2.05 m by three cameras, or by one and their height, beside an adult of average height.",
        "error <= 1.3 of the adult's in 95 %, height within 3 %",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.accuracy.calibration_ranks",
        "Ranks of true joint angles in a tracker's posterior, of poses that its prior expects and of poses anywhere.",
        "from the prior: error <= 0.08, no joint beyond the band of chance",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.accuracy.degrees",
        "Joint angles of phone films without a camera file against markers, beside two learned peers.",
        "legs at most 6.0 degrees, 4.5 with their own zero",
        (OPENCAP,),
    ),
    Measure(
        "benchmarks.accuracy.beam4cam",
        "Errors on the real clip beam4cam: each camera alone and all four, and what pictures add to the keypoints.",
        "one camera: MPJPE < 144.1, PA < 92.4 mm; four: MPJPE <= 35 mm",
        (BEAM4CAM,),
    ),
    Measure(
        "benchmarks.accuracy.beam4cam_masks",
        "Makes masks of the person of beam4cam for `beam4cam --masks`: GrabCut of every picture.",
        "",
        (BEAM4CAM, RUN),
    ),
    Measure(
        "benchmarks.accuracy.demo",
        "Errors on the built-in clip: several draws of its keypoints' noise, each camera alone.",
        "< 50 mm",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.accuracy.mocap",
        "Errors on captured motion, rendered, one camera, another body: from pictures, from keypoints, from both.",
        "pictures: none lost, <= 80 mm; both: <= 70 mm",
        (MOCAP,),
        (MOCAP_MORE,),
    ),
    Measure(
        "benchmarks.accuracy.unseen",
        "Errors on captured people left out of learning, one camera: by clip, by action, by how fast they turn.",
        "hips aligned <= 95, PA <= 66 mm; over 250 mm <= 1 %; angles <= 9 degrees",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.accuracy.gradients",
        "Gradients against central differences, energies along searches, residuals at their ends.",
        "1e-5; energy never rises; KKT residual < 1e-6",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.accuracy.bends",
        "People of several builds who stand, walk, squat, rise and jump, by one to four virtual phones: joint angles.",
        "standing knees and elbows 3 degrees (6 by one phone), legs 4 (two), 3 (four), 6 (one); bands 85 to 95 %",
        (OPENCAP,),
    ),
    Measure(
        "benchmarks.accuracy.trunk_views",
        "Which way a trunk leans in one phone's view: two films' people and captured people who bend, from all sides.",
        "lean 8 degrees from 0 and 10 degrees, 5 elsewhere; hips 10; never to the wrong side for 0.3 s; reported 97 %",
        (OPENCAP,),
        (MOCAP, MOCAP_MORE, ASAP),
    ),
    Measure(
        "benchmarks.accuracy.foot_contact",
        "When feet stand, by markers on heels and toes, against force plates.",
        "F1 0.9",
        (OPENCAP,),
    ),
    Measure(
        "benchmarks.accuracy.forces",
        "Ground reaction forces, centres of pressure and joint moments by markers against plates of three people.",
        "total of walking 4 / 2 / 1.2 % of the weight, each foot 5 / 2 / 1.2",
        (OPENCAP,),
    ),
    Measure(
        "benchmarks.accuracy.captured_forces",
        "The sum of the forces of captured people, from keypoints of one camera, against that of their true motion.",
        "",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.accuracy.outline",
        "Widths of the body's outline beside those of beam4cam's silhouettes, across limbs, hips and head.",
        "",
        (BEAM4CAM,),
    ),
    Measure(
        "benchmarks.accuracy.detection",
        "Keypoints that `kinemode detect` finds in beam4cam's videos beside the shipped ones, and the tracks of both.",
        "3 px; MPJPE, PA <= 1.1 times",
        (BEAM4CAM, DETECTOR),
    ),
    Measure(
        "benchmarks.accuracy.synchronisation",
        "`--sync auto`: clocks of cameras found from their keypoints, and their uncertainty.",
        "19 of 20 within a frame, or uncertain",
        (BEAM4CAM, MOCAP),
    ),
    Measure(
        "benchmarks.accuracy.rigs",
        "Cameras and clocks found from a person who moves before them: beam4cam, random rigs around captured people.",
        "K given: 1.5 degrees, 4 %; guessed: 3 degrees, 8 %; random rigs: 90 % within 2 degrees, 4 %, others uncertain",
        (BEAM4CAM, MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.accuracy.rig_faults",
        "Cameras that are moved during a clip or see another motion, or were moved since a calibration: whether named.",
        "a camera that moved, or whose person is another one, is named",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.accuracy.rig_motions",
        "What a person has to do before two phones for their cameras to be found: angle, motion, seconds.",
        "",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.accuracy.crowd",
        "Several people: time to read a crowd's keypoints, and errors of a person tracked among others and alone.",
        "< 5 s; errors as alone",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.accuracy.everybody",
        "`--person all`: people crossing before four cameras: swapped or not, and each tracked as well as alone.",
        "no one swapped, 1.1 times alone",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.accuracy.everybody_filmed",
        "How well the detector sees two rendered people crossing before four cameras, together and alone.",
        "no one swapped, 1.1 times alone",
        (DETECTOR,),
    ),
    # points
    Measure(
        "benchmarks.points.points",
        "Tracks of markers: errors against captured motion, a laboratory and OpenSim, bands, processor time, cameras.",
        "1.0 ms a frame; four cameras as points <= 1.15 of their keypoints",
        (NOTHING,),
        (OPENCAP, MOCAP, BEAM4CAM, OPENSIM),
    ),
    # retargeting
    Measure(
        "benchmarks.retargeting.retarget",
        "Motions of persons on robots: limits, collisions, standing feet and likeness, ours and peers'.",
        "no violated limits, collisions <= 1 mm, below the floor <= 5 mm, slip <= 5 mm, limbs <= 12 degrees;"
        " other beginnings <= 2 degrees; >= 100 frames/s",
        (ASAP, MOCAP, MOCAP_MORE),
        (EXTRA,),
    ),
    # papers_css
    Measure(
        "benchmarks.papers_css.css_tables",
        "Table 1 of CSS: where covariance-scaled and spherical samples lie, and which minima searches from them find.",
        ">= 3 times as many minima at scale 8",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.papers_css.failures",
        "The failures of CSS section 6: which tracker loses which stand-in sequence, all in equal time.",
        "lost in at most 1 of 27 (css)",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.papers_css.sequences",
        "Stand-ins for the sequences of CSS section 6: joints given in the first frame, then pictures alone.",
        "smoothed: arm <= 12, pivot <= 45, turn and reach <= 40 mm",
        (NOTHING,),
        (INDEX,),
    ),
    Measure(
        "benchmarks.papers_css.ablation",
        "CSS without one of its parts at a time, at an equal number of searches, beside the whole.",
        "10 % in error or runs lost, beyond two standard errors",
        (BEAM4CAM, MOCAP),
    ),
    Measure(
        "benchmarks.papers_css.interpretations",
        "Forward/backward interpretations of one picture that are found within the budget of one frame.",
        ">= 95 %",
        (NOTHING,),
    ),
    # papers_elmo
    Measure(
        "benchmarks.papers_elmo.elmo",
        "ELMO section 4.1: errors of ELMO and its rivals on stereo sequences (Figures 4, 5) and times (Table 1).",
        "mean <= 30 mm, over 100 mm <= 2 %; <= 0.5 s a frame",
        (INDEX, MOCAP),
    ),
    Measure(
        "benchmarks.papers_elmo.elmo_figures",
        "Draws Figures 4 and 5 of ELMO: errors by sequence and tracker, and frame by frame.",
        "",
        (ELMO_FIGURES,),
    ),
    Measure(
        "benchmarks.papers_elmo.elmo_single",
        "ELMO in single frames: random poses, searched from the neighbours of an index and from random examples.",
        "median <= 30 mm, 75 % under 50; <= 0.75 of random examples",
        (INDEX,),
    ),
    Measure(
        "benchmarks.papers_elmo.elmo_recovery",
        "First frames, and first frames after full occlusions, of ELMO and its rivals.",
        "six of six <= 60 mm; 90 % <= 60, within 3 frames",
        (INDEX, MOCAP),
    ),
    Measure(
        "benchmarks.papers_elmo.elmo_silhouette",
        "ELMO with one camera and no depth: modes of edges and silhouette.",
        "",
        (INDEX, MOCAP),
    ),
    Measure(
        "benchmarks.papers_elmo.index",
        "An index of examples: errors of a picture's neighbours beside exact search and chance, and time of a query.",
        "query <= 1 ms, <= 80 MB; <= 1.35 of the nearest",
        (INDEX,),
        (EXTRA,),
    ),
    # papers_loose_limbed
    Measure(
        "benchmarks.papers_loose_limbed.loose_limbed",
        "Loose-limbed people before four cameras: tracking, the annealed filter, first frames, recovery.",
        "beliefs 45, assembled 35 mm",
        (MOCAP,),
        (MOCAP_MORE,),
    ),
    Measure(
        "benchmarks.papers_loose_limbed.loose_limbed_figures",
        "Draws Figures 4, 6, 7 and 8 (left) of Sigal et al. (2004) on captured walking.",
        "",
        (MOCAP,),
    ),
    Measure(
        "benchmarks.papers_loose_limbed.messages",
        "Products of messages: how near draws from them are to the truth, and their time.",
        "0.08; 3 mm, 1 degree; 150 ms",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.papers_loose_limbed.assembly",
        "Poses assembled from beliefs of single limbs: errors of limb ends before and after, and time.",
        "lower than the beliefs' errors",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.papers_loose_limbed.limb_detectors",
        "Recall and precision of part detectors without a pose, on rendered people, rooms and clips not trained on.",
        "",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.papers_loose_limbed.limb_templates",
        "Recall and precision of multi-view eigen-templates as part detectors.",
        "recall: head .9; upper arms, calves .7",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.papers_loose_limbed.limb_keypoints",
        "Keypoints as part detectors on beam4cam: recall and precision of pairs of views and of one view.",
        "recall .95, precision .8",
        (BEAM4CAM,),
    ),
    # papers_dual_chain
    Measure(
        "benchmarks.papers_dual_chain.dual_chain",
        "The dual-chain tracker, likelihood sampling and CONDENSATION on three rendered clips of an upper body.",
        "<= 60 mm; <= 0.5 s a frame",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.papers_dual_chain.dual_chain_events",
        "Hands that cross, come before the face, are lost or exchanged: whether dual-chain keeps them apart.",
        "error <= 1.3 of before; right hands 95 %",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.papers_dual_chain.limb_losses",
        "How often dual-chain loses an arm that it had: the rate of `dual_chain.pose.lost`.",
        "",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.papers_dual_chain.dual_chain_figures",
        "Draws Figures 2 and 3 of Taycher et al. (2004): 40 samples of the posterior, front and side.",
        "",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.papers_dual_chain.chains",
        "Chains combined through a shared point beside exact inference, on two random walks.",
        "1e-6; 90 % regions: 85 to 95 %",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.papers_dual_chain.blobs",
        "Hands found as blobs of skin, by a colour learned in the first frame alone.",
        "95 %; 0.1 false blobs a frame",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.papers_dual_chain.limb_ik",
        "Arms drawn from an image by inverse kinematics: number a second, exactness, and weights.",
        "p > 0.01; 1e-9 m; 50,000 a second",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.papers_dual_chain.outline_likelihood",
        "Likelihood of many poses by one picture: poses a second, and how often the true pose is the likelier.",
        "95 %; 20,000 a second",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.papers_dual_chain.css_dual",
        "What a chain of keypoints beside css keeps where keypoints of beam4cam are taken away.",
        "loss halved; untouched at most 0.5 mm worse",
        (BEAM4CAM,),
    ),
    # robustness
    Measure(
        "benchmarks.robustness.structure",
        "Modules and lines, the files that an observation crosses within a frame, and those that mention an option.",
        "at most 8 files for an observation, 4 for an option",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.robustness.bits",
        "Whether a change of the code changes a bit of what is tracked: fixed cases, hashed and compared.",
        "22 of 22 equal",
        (NOTHING,),
        (BEAM4CAM,),
    ),
    Measure(
        "benchmarks.robustness.resume",
        "Runs killed at any moment and resumed, against runs that nothing disturbed.",
        "same result, nothing left after 2 s",
        (NOTHING,),
        (BEAM4CAM,),
    ),
    Measure(
        "benchmarks.robustness.batch",
        "A batch of clips by several processes and by Dask: time, equal bits; killed, of idle jobs, and very long.",
        "two processes >= 1.8 of one, Dask >= 0.9 of them; equal bits",
        (NOTHING,),
        (EXTRA,),
    ),
    Measure(
        "benchmarks.robustness.fuzz",
        "Damaged files through every reader and through the commands: a result or one short line.",
        "0 faults",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.robustness.worlds",
        "Captured motions by three cameras in arbitrarily turned worlds: upright exports, or a question; strides.",
        "upright within 2 degrees or a question; strides within 2 %",
        (MOCAP,),
    ),
    Measure(
        "benchmarks.robustness.floors",
        "People who stand, climb, sit, lie and hang: joint angles with the floor found from the feet and without one.",
        "found at most 0.5 degrees worse in every scene",
        (NOTHING,),
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.robustness.silent_faults",
        "Faults of points, keypoints and sources, drawn at random: right angles, hard frames, files refused.",
        "none silent",
        (NOTHING,),
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.robustness.boards",
        "Rigs placed by a small, far board whose mirrored solutions fit nearly as well: wrong placements, and doubts.",
        "no wrong placement without a doubt",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.robustness.urdfs",
        "Every installed URDF, loaded and posed, beside forward kinematics by numpy: the worst link, or the refusal.",
        "all links within 1e-9 m; one line for a refused file",
        (NOTHING,),
    ),
    Measure(
        "benchmarks.robustness.disagreement",
        "beam4cam from four cameras with files that disagree in size, frame rate and clock.",
        "within 10 % of the originals; refused or warned where not given",
        (BEAM4CAM,),
    ),
    # training
    Measure(
        "benchmarks.training.keypoint_places",
        "Where MediaPipe marks two people whose joints are known, off from human34's landmarks.",
        "",
        (OPENCAP,),
    ),
    Measure(
        "benchmarks.training.rest_positions",
        "Rest positions and widths of human34's joints, from captured people and people with markers: its stabilisers.",
        "denser at people left out than the shipped ones",
        (MOCAP, MOCAP_MORE, OPENCAP),
    ),
    Measure(
        "benchmarks.training.balance",
        "Where the centre of mass of captured people is over the feet that stand: the numbers of the balance term.",
        "",
        (MOCAP, MOCAP_MORE),
        (OPENCAP,),
    ),
    Measure(
        "benchmarks.training.limb_colours",
        "Colours of halves of one limb, and where limbs end by colour, at true poses of rendered captured people.",
        "",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.training.trunk_evidence",
        "Which terms of the energy part the two readings of a trunk, on captured people who bend.",
        "",
        (MOCAP, MOCAP_MORE),
        (ASAP,),
    ),
    Measure(
        "benchmarks.training.pose_prior",
        "The shipped pose prior: tried on people that were held out; `--write` learns and writes it.",
        "PA 8 mm lower, mean and median",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.training.accelerations",
        "Accelerations of captured motion: deviations, memory and pace, each person's foretold by the others'.",
        "",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.training.shared_places",
        "How long hands of captured people stay where they are inside a blob of skin that is another's too.",
        "",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.accuracy.followed_points",
        "By how much points of rendered people are followed wrongly, by their own part's pixels and by all.",
        "",
        (MOCAP,),
    ),
    Measure(
        "benchmarks.accuracy.silhouettes",
        "How wrongly people are separated from a background that is learned from their own clip.",
        "",
        (MOCAP,),
    ),
    Measure(
        "benchmarks.training.rest_times",
        "How long joints of captured people stay away from their rest positions.",
        "",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.training.walking_forwards",
        "How much rather captured people move forwards than backwards.",
        "",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.training.limb_learning",
        "The shipped potentials between limbs: tried on clips that were held out; `--write` learns and writes them.",
        "walk_straight 13.5, punch 11, jump 13.5 nats",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.training.limb_likelihood",
        "The shipped likelihood of limbs: tried on people and rooms not seen; `--write` learns and writes it.",
        "80,000 likelihoods a second",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.training.overconfidence",
        "Errors of modes found in pictures over their own deviations, by which smoothing ties to them.",
        "",
        (MOCAP, MOCAP_MORE),
    ),
    Measure(
        "benchmarks.training.calibration",
        "Coverage of the posterior's regions on motions that were held out; `--fit` fits the shipped calibration.",
        "85 to 95 %; error <= 0.08",
        (NOTHING,),
        (MOCAP, MOCAP_MORE),
    ),
)


def by_name(measures: Iterable[Measure] = MEASURES) -> dict[str, Measure]:
    """The measures by their names."""
    return {measure.name: measure for measure in measures}


def find(name: str) -> Measure:
    """The measure of a name; raises InputError, with the nearest names, where there is none."""
    known = by_name()
    if name not in known:
        remedy = f"{nearest(name, known, 'names')}; python -m benchmarks --list prints all"
        raise InputError("benchmarks", f"there is no measure {name!r}", remedy=remedy)
    return known[name]
