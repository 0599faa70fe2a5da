"""Inverse dynamics of a run: its forces, joint moments and powers."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from estimator.data.sequence import Progress
from estimator.data.standing import HIP_SPAN
from estimator.dynamics.contact_forces import ContactLoads, ForceSettings, InverseDynamics, Support
from estimator.dynamics.motion import Motion, facing
from estimator.dynamics.soles import SIDES, SolePoints
from estimator.dynamics.uncertainty import UncertaintySettings, samples_of
from estimator.energy.priors import up_is_assumed
from estimator.inference.contacts import FootPoints, HandPoints
from estimator.runs.contact import contact_of_run
from estimator.runs.coordinates import joint_entries
from estimator.runs.forces import BodyMass, Forces, ForceSamples
from estimator.runs.run_motion import motion_of_run, other_motions
from estimator.runs.run_reader import Run
from humanoid.kinematics.body import ROOT_JOINT, ROOT_V, Body
from humanoid.shape.segment_masses import has_own_masses, height_over_heels, is_person, person_inertias
from humanoid.shape.solids import heights_above_soles
from humanoid.support.errors import InputError

_BY_STATURE = (-105.0, 101.8, 9.3)
"""Body mass by stature: constant [kg], slope [kg/m] and residual standard deviation [kg] of 507 adults (G. Heinz, L.
Peterson, R. Johnson, C. Kerk, J. Stat. Educ. 11(2), 2003)."""
_LEAST, _MOST = 2.0, 500.0  # kg
_NEAR, _MAYBE = 0.06, 0.05
"""[m] Points so near to the ground may carry, with this probability at least, where something has to: feet that take
off or land move as fast as others that swing."""
_FALLS = 0.2  # weights that carry somebody, up to which they may be in flight
_DOUBTED = 0.1  # weights that the balance of the root may lack
_LOW_HIPS = 0.75  # of their usual height: hips up to there may rest on something
_STILL, _MOST_OF_IT = 0.02, 0.8  # m: standard deviation of resting hips, which settle; share of a span that is there


def forces_of_run(
    run: Run,
    mass: float | None = None,
    *,
    seed: int = 0,
    settings: ForceSettings | None = None,
    uncertainty: UncertaintySettings | None = None,
    progress: Progress | None = None,
) -> Forces:
    """Forces of a run's drawn trajectory.

    mass [kg]: of the body, with whatever it carries; by default that of the URDF, or of a person as tall.

    Raises
    ------
    InputError: a mass that is none; a body without masses that is not a person; one with a free root and without feet;
        feet that never stand, or on a treadmill of unknown speed; fewer than eight poses in a row.
    """
    body, weighed = run.body, mass_of(run.body, mass)
    inertias = inertias_of(body, weighed)
    motion = motion_of_run(run)
    if not motion.known.any():
        raise InputError(run.file, "has no eight poses in a row", remedy="track a longer clip")
    support, heights, seat = _support(run) if body.has_free_root else (None, None, None)
    palms = None if support is None else HandPoints.of(body)
    dynamics = InverseDynamics(
        body, inertias, settings or ForceSettings(), seat, None if palms is None else palms.landmark
    )
    if support is not None and heights is not None:
        support = _with_near(support, heights, dynamics.force_of_acceleration(motion)[:, 2] / dynamics.weight + 1.0)
    chosen = uncertainty or UncertaintySettings()
    at_best = None if support is None else support.blurred(run.time, chosen.strike)
    loads = dynamics.loads(motion, at_best)
    drawn = []
    rng = np.random.default_rng(seed)
    sampled = samples_of(rng, dynamics, motion, other_motions(rng, run, chosen), support, chosen)
    for done, sample in enumerate(sampled, 1):
        drawn.append(_quantities(body, motion, sample))
        if progress is not None:
            progress(done, chosen.samples)
    residual = _residual(body, motion, loads)
    samples = ForceSamples(*(np.array(part, dtype=np.float32) for part in zip(*drawn, strict=True)))
    return Forces(
        time=run.time,
        mass=weighed,
        feet=SIDES if support is not None else (),
        hand_names=() if palms is None else palms.names,
        names=tuple(body.v_names[body.first_joint_dof :]),
        units=_units(body),
        **_quantities(body, motion, loads)._asdict(),
        residual=residual,
        facing=facing(body, motion),
        samples=samples,
        remark=_remark(run, motion, residual, dynamics.weight),
    )


def mass_of(body: Body, given: float | None) -> BodyMass:
    """A body's mass: as given [kg], else its URDF's, else that of adults as tall.

    Raises InputError for a number that is no mass, and for a body without masses that is not a person.
    """
    if given is not None:
        if not _LEAST <= given <= _MOST:
            raise InputError("mass", f"must be {_LEAST:g} to {_MOST:g} kg, got {given:g}", remedy="give kilograms")
        return BodyMass(float(given), 0.0, "given")
    if has_own_masses(body):
        return BodyMass(float(sum(i.mass for i in body.model.inertias)), 0.0, "of the URDF")
    tall = height_over_heels(body, "head_top") if is_person(body) else None
    if tall is None:
        problem = "has no masses, and is not a person from head to heels"
        remedy = "give --mass" if is_person(body) else "add <inertial> to its links"
        raise InputError(body.subject.source, problem, remedy=remedy)
    constant, slope, std = _BY_STATURE
    return BodyMass(max(constant + slope * tall, _LEAST), std, f"of adults of {tall:.2f} m")


def inertias_of(body: Body, mass: BodyMass) -> list[pin.Inertia]:
    """Inertias of the joints' segments, which together have a mass."""
    if not has_own_masses(body) and not is_person(body):
        problem = "has no masses, and no links with the names of a person's segments"
        raise InputError(body.subject.source, problem, remedy="add <inertial> to its links")
    inertias = person_inertias(body, mass.kilograms)
    scale = mass.kilograms / sum(inertia.mass for inertia in inertias)
    return [pin.Inertia(scale * i.mass, i.lever, scale * i.inertia) for i in inertias]


def _support(run: Run) -> tuple[Support, np.ndarray, np.ndarray | None]:
    """What may carry a run's body over time, how high (T, P) [m] the points of the feet are over the ground, and the
    place (3,) [m] of a seat in the root's frame."""
    contact = contact_of_run(run, hands=True) if SolePoints.of(run.body) is not None else None
    if contact is None:
        remedy = "forces need a person with feet, such as human34, or a body with a fixed base"
        raise InputError(run.header.subject_source, "has no heels and toes as landmarks", remedy=remedy)
    if np.isnan(contact.standing).any():
        raise InputError(run.file, contact.remark, remedy="forces need to know when feet stand")
    if not (contact.standing > 0.5).any():
        raise InputError(run.file, "the feet never stand", remedy="check with kinemode contact; forces need contact")
    seat, seated = _seat(run)
    hands = np.zeros((len(run.time), 0)) if contact.hands is None else contact.hands
    return Support(contact.standing, seated, hands), _heights(run, contact.heights), seat


def _heights(run: Run, over_floor: np.ndarray) -> np.ndarray:
    """Heights (T, P) [m] of the points of the feet over the floor or, without one, over the lowest of them."""
    feet = FootPoints.of(run.body)
    if feet is None or not np.isnan(over_floor).all():
        return np.nan_to_num(over_floor, nan=np.inf)
    heights = run.landmarks[:, feet.landmark, 2] - feet.above[feet.kind]
    return np.nan_to_num(heights - heights.min(axis=1, keepdims=True), nan=np.inf)


def _with_near(support: Support, heights: np.ndarray, needed: np.ndarray) -> Support:
    """The support in which points near the ground may carry, too, in frames in which something has to. heights (T, P)
    [m]: see `_heights`. needed (T,): the force that the motion needs, in weights."""
    near = (heights < _NEAR) & (needed > _FALLS)[:, None]
    return support._replace(standing=np.where(near, np.maximum(support.standing, _MAYBE), support.standing))


def _seat(run: Run) -> tuple[np.ndarray | None, np.ndarray]:
    """The place (3,) [m] of a seat below the hips in the root's frame, None for a body without a middle of the hips,
    and the probability (T,) that they rest on something: they are low, and stay where they are for half a second."""
    body, names = run.body, run.body.landmark_names
    usual = height_over_heels(body, "mid_hip")
    if usual is None or body.landmark_joint[k := names.index("mid_hip")] != ROOT_JOINT:
        return None, np.zeros(len(run.time))
    up = np.array([0.0, 0.0, 1.0])
    local = body.landmark_local[k] - heights_above_soles(body, [k])[0] * up
    hips = run.landmarks[:, k]
    low = hips[:, 2] - _ground(run) < _LOW_HIPS * usual
    return local, np.where(low, _resting(run.time, hips), 0.0)


def _resting(time: np.ndarray, hips: np.ndarray) -> np.ndarray:
    """Probability (T,) that hips (T, 3) [m] rest at times (T,) [s], by how little they wander in the stillest span of
    `HIP_SPAN` that a frame is in: at the bottom of a squat or a landing they turn sooner."""
    resting = np.zeros(len(time))
    for first, after in enumerate(np.searchsorted(time, time + HIP_SPAN, side="right")):
        span = hips[first:after]
        if time[after - 1] - time[first] < _MOST_OF_IT * HIP_SPAN or not np.isfinite(span).all():
            continue
        wander = float(np.sqrt(span.var(axis=0).sum()))
        resting[first:after] = np.maximum(resting[first:after], np.exp(-0.5 * np.square(wander / _STILL)))
    return resting


def _ground(run: Run) -> float:
    """Height [m] of the ground: where the lowest heel or toe usually is."""
    feet = [k for k, name in enumerate(run.body.landmark_names) if name.endswith(("heel", "toe"))]
    return float(np.nanmedian(run.landmarks[:, feet, 2].min(axis=1)))


def _units(body: Body) -> tuple[str, ...]:
    """The units of what drives each degree of freedom but a free root's."""
    units = np.full(body.nv, "N m", dtype="<U3")
    for entry in joint_entries(body):
        if entry.kind == "slide" and not entry.follows:
            units[body.place(entry.name).v] = "N"
    return tuple(str(unit) for unit in units[body.first_joint_dof :])


def _quantities(body: Body, motion: Motion, loads: ContactLoads) -> ForceSamples:
    """Quantities (T, ...) of loads."""
    moment = loads.torque[:, body.first_joint_dof :]
    power = moment * motion.v[:, body.first_joint_dof :]
    return ForceSamples(loads.force, loads.pressure, loads.free_moment, loads.seat, loads.hands, moment, power)


def _residual(body: Body, motion: Motion, loads: ContactLoads) -> np.ndarray:
    """What the balance of the root lacks (T, 6) [N, N m], in the world; 0 of a fixed base."""
    residual = np.where(motion.known[:, None], np.zeros(6), np.nan)
    if body.has_free_root:
        R_world_root = body.placed(motion.q[motion.known]).rotations_of(ROOT_JOINT)
        wrench = loads.torque[motion.known, ROOT_V].reshape(-1, 2, 3)
        residual[motion.known] = np.einsum("tij,tkj->tki", R_world_root, wrench).reshape(-1, 6)
    return residual


def _remark(run: Run, motion: Motion, residual: np.ndarray, weight: float) -> str:
    """Reasons for doubt."""
    doubts = []
    if up_is_assumed(run.header.cameras):
        doubts.append("gravity is taken along the camera's own upright: 2 degrees off are 3.5 % of the weight sideways")
    if run.smoothed is None and run.filtering is None:
        doubts.append("the run was not smoothed: accelerations are rough; smooth it, or give a cut-off to filter it")
    lacking = np.linalg.norm(residual[:, :3], axis=1) > _DOUBTED * weight
    if lacking.any():
        share = lacking.sum() / np.isfinite(residual[:, 0]).sum()
        doubts.append(
            f"in {share:.0%} of the frames the motion needs a tenth of the weight or more that nothing known can carry:"
            " contact is doubtful there (see kinemode contact), or something else carries"
        )
    if len(motion.parts) > 1 or not motion.known.all():
        spans = ", ".join(f"{run.time[a]:.2f} to {run.time[b - 1]:.2f} s" for a, b in motion.parts)
        doubts.append(f"forces are given from {spans} alone: they end at gaps")
    return "; ".join(doubts)
