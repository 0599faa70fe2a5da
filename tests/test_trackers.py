"""The common behaviour of trackers over a longer clip, that of each, and settings by name."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from builders import body_of, camera_at, inside, observe

from estimator.data.formats.packing import pack, unpack
from estimator.data.image_cues import ImageCues
from estimator.data.observation import Observation
from estimator.inference.clusters import mean_and_covariance
from estimator.synthesis.motion import authored_motion
from estimator.trackers.base import State, TrackerProtocol, capabilities_of, energy_of
from estimator.trackers.baselines.single_mode import unlimited
from estimator.trackers.frame_result import FrameResult
from estimator.trackers.particle_set import FrameEnergy, ParticleState
from estimator.tracking.registry import TRACKERS, Settings, make_tracker, settings_for
from estimator.tracking.runner import run, run_into
from humanoid.subject.landmarks import mirror_index
from humanoid.support.errors import InputError
from tests.tiny_clip import FEW_STARTS

CAMERA = camera_at(30.0, distance=3.5, focal=660.0, height=1.2, aim=(0.0, 0.0, 0.95))
FRAMES, FPS, MISSING, SEED = 7, 30.0, 4, 5
NOISE = (0.5, 4.0)
LIMBS = [f"{s}_{p}" for s in ("left", "right") for p in ("elbow", "wrist", "hip", "knee", "ankle")]


@cache
def truth() -> np.ndarray:
    return authored_motion(body_of("human34"), 0.4 + np.arange(FRAMES) / FPS)


@cache
def clip(noise: float) -> tuple[Observation, ...]:
    """A person reaching and turning, one camera; one frame without keypoints."""
    body, rng = body_of("human34"), np.random.default_rng(81)
    frames = [observe(body, q, [CAMERA], noise=noise, rng=rng, index=i, time=i / FPS) for i, q in enumerate(truth())]
    lost = frames[MISSING]
    frames[MISSING] = replace(lost, pixels=lost.pixels * np.nan, confidence=lost.confidence * 0.0)
    return tuple(frames)


MODES = 4
FEW: dict[str, dict[str, object]] = {
    "css": {"samples": 6, "budget": {"searches": 16}},
    "css_dual": {"samples": 6, "budget": {"searches": 16}},
    "single_mode": {},
    "markers": {"samples": 4},
    "condensation": {"particles": 300},
    "annealed": {"layers": 6, "particles": 80},
    "multiple_hypothesis": {"starts": 8},
}
PARTICLES = ("annealed", "condensation")
UNCONSTRAINED = ("gaussian-single-mode", "robust-single-mode", "gaussian-multiple-hypothesis")


def small(name: str) -> Settings:
    """The tracker's own settings, with few samples."""
    spec = TRACKERS[name]
    changes = {spec.group: FEW[spec.group], "search": FEW_STARTS}
    return settings_for(name, modes=MODES if spec.keeps_several else None, changes=changes)


def tracker(name: str) -> TrackerProtocol[Any]:
    return make_tracker(name, body_of("human34"), small(name))


Track = list[tuple[FrameResult, State]]


@cache
def track(name: str, noise: float) -> Track:
    return [(r, s) for r, s in run(tracker(name), clip(noise), SEED) if s is not None]


def same_result(a: FrameResult, b: FrameResult) -> bool:
    ours, theirs = (vars(r) | r.extra | ({} if r.origins is None else r.origins.arrays()) for r in (a, b))
    names = [name for name in ours if name not in ("origins", "extra")]
    return set(ours) == set(theirs) and all(_equal(ours[name], theirs[name]) for name in names)


def _equal(x: Any, y: Any) -> bool:
    return np.array_equal(x, y, equal_nan=np.asarray(x).dtype.kind == "f")


BY_POINTS = [name for name in TRACKERS if TRACKERS[name].group not in ("elmo", "loose_limbed", "dual_chain")]
"""For the others see `test_elmo`, `test_loose_limbed` and `test_dual_chain`; they keep the contract."""


@pytest.fixture(params=BY_POINTS)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(params=NOISE)
def noise(request: pytest.FixtureRequest) -> float:
    return float(request.param)


def test_the_requested_number_of_hypotheses_without_overlapping_parts(name: str, noise: float) -> None:
    results = [r for r, _ in track(name, noise)]
    for r in results:
        assert 1 <= len(r.weight) <= MODES
        assert r.penetration.max() <= 0.01 or name in (*UNCONSTRAINED, *PARTICLES)
    statuses = [r.status for r in results]
    assert statuses.count("unobserved") == 1
    assert set(statuses) <= {"tracked", "hard", "unobserved"}


def test_the_person_is_followed(name: str) -> None:
    """With little noise the best hypothesis stays with the person, up to the depth that one camera leaves open."""
    body = body_of("human34")
    errors, fits = [], []
    for (r, _), q, seen in zip(track(name, NOISE[0]), truth(), clip(NOISE[0]), strict=True):
        points, true = body.landmarks(body.at(r.q[0])), body.landmarks(body.at(q))
        errors.append(np.linalg.norm(points - true, axis=1).mean())
        fits.append(np.linalg.norm(CAMERA.project(points) - seen.pixels[0], axis=1).mean())
    assert np.mean(errors) < 0.15
    assert np.nanmax(fits) < (20.0 if name in PARTICLES else 6.0)


def test_a_track_continues_across_an_unseen_frame(name: str) -> None:
    """From the stored state, to the same result, to the last bit."""
    whole = track(name, NOISE[1])
    for broken in (MISSING - 1, MISSING):
        goes_on = tracker(name)
        state = goes_on.state_from(unpack(pack(whole[broken][1].arrays())))
        resumed = run(goes_on, clip(NOISE[1]), SEED, state=state, first=broken + 1)
        assert all(same_result(a, b) for (a, _), (b, _) in zip(whole[broken + 1 :], resumed, strict=True))


def test_an_invalid_state_is_refused(name: str) -> None:
    """If any array of it is missing, of another shape or kind, or not finite."""
    goes_on = tracker(name)
    arrays = track(name, NOISE[1])[1][1].arrays()
    for which, array in arrays.items():
        damaged = [{**arrays, which: array[..., None]}, {k: v for k, v in arrays.items() if k != which}]
        damaged += [{**arrays, which: array.astype(str) if array.dtype.kind != "U" else np.zeros(array.shape)}]
        for wrong in damaged:
            with pytest.raises(ValueError, match=which):
                goes_on.state_from(wrong)
    with pytest.raises(ValueError, match="q"):
        goes_on.state_from({**arrays, "q": arrays["q"] * np.nan})


def test_keypoint_trackers_begin_with_four_keypoints_whatever_the_pictures_show(name: str) -> None:
    seen, begins = clip(NOISE[0]), tracker(name)
    assert begins.needs_keypoints
    for count, enough in ((0, False), (3, False), (4, True)):
        few = replace(seen[0], confidence=seen[0].confidence * (np.arange(seen[0].confidence.size) < count))
        assert begins.can_start(few) is enough
        pictures = tuple(ImageCues(camera) for camera in few.cameras)
        assert begins.can_start(replace(few, cues=pictures)) is enough
    can = capabilities_of(begins)
    assert can.energy is not None
    assert (can.frames_ahead, can.frames_behind) == (0, 0)


STEPS = ("steps_active_set", "steps_failed", "steps_free", "steps_proxqp")
OF_CSS = ("searches", "searches_kinematic_jump", "searches_limb_elsewhere", "searches_limbs_exchanged",
            "searches_other_association", "searches_parent", "searches_sample", *STEPS)  # fmt: skip
TOLD = {
    "css": OF_CSS,
    "css_dual": ("kept_pixels", "kept_std", *OF_CSS),
    "single_mode": ("searches", "searches_parent", *STEPS),
    "markers": ("searches", "searches_parent", "searches_sample", *STEPS),
    "multiple_hypothesis": ("searches", "searches_sample", *STEPS),
    "condensation": ("effective_sample_size", "log_evidence", "resampled"),
    "annealed": ("annealing_power", "effective_sample_size"),
}  # fmt: skip


def test_each_tracker_reports_its_own_arrays(name: str, noise: float) -> None:
    results = [r for r, _ in track(name, noise)]
    few = FEW[TRACKERS[name].group]
    for r in results:
        searched = r.status != "unobserved" and r.index > 0
        assert tuple(sorted(r.extra)) == (TOLD[TRACKERS[name].group] if searched else ())
        if "effective_sample_size" in r.extra:
            sizes = r.extra["effective_sample_size"]
            assert sizes.shape == r.extra.get("annealing_power", np.zeros(())).shape
            assert np.all((sizes >= 1.0 - 1e-9) & (sizes <= few["particles"] * (1.0 + 1e-9)))
        if "searches" in r.extra:
            assert r.extra["searches"] == sum(r.extra[n] for n in r.extra if n.startswith("searches_")) > 0
            assert sum(r.extra[n] for n in STEPS) > 0
        with pytest.raises(ValueError, match="read-only"):
            next(iter(r.extra.values()), np.frombuffer(b""))[...] = 0
    if name == "css":
        families = np.concatenate([r.origins.family for r in results if r.extra and r.origins is not None])
        nonzero = {n for r in results for n in r.extra if r.extra[n] > 0}
        assert {f"searches_{f.replace(' ', '_')}" for f in families} <= nonzero


def test_the_log_evidence_is_the_mean_likelihood_of_the_particles() -> None:
    """Computed again from the energies of the moved particles; a temperature divides them."""
    body, seen = body_of("human34"), clip(NOISE[1])[:2]
    for temperature in (1.0, 3.0):
        changes = {"condensation": {"particles": 40, "temperature": temperature}}
        filtering = make_tracker("condensation", body, settings_for("condensation", changes=changes))
        (_, before), (result, after) = run(filtering, seen, SEED)
        assert isinstance(before, ParticleState)
        assert isinstance(after, ParticleState)
        energy = FrameEnergy(energy_of(filtering, "condensation"), seen[1], before.mixture)
        poses = after.particles.states[:, : body.nq]
        likelihood = np.exp(-energy.values(poses, np.zeros(40, dtype=int)) / temperature)
        assert result.extra["log_evidence"] == pytest.approx(np.log(likelihood.mean()), rel=1e-9)
        share = likelihood / likelihood.sum()
        assert result.extra["effective_sample_size"] == pytest.approx(1.0 / np.sum(share**2), rel=1e-9)
        assert result.extra["resampled"]


def test_extra_arrays_are_the_results_own_and_of_plain_kinds() -> None:
    given = np.zeros(2)
    result = replace(track("single-mode", NOISE[0])[0][0], extra={"blobs": given})
    given[0] = 1.0
    assert not result.extra["blobs"].any()
    assert not replace(result, status="hard").extra["blobs"].flags.writeable
    for extra in ({"Blobs": np.zeros(2)}, {"blobs": np.array([None])}, {"blobs": np.zeros((1,) * 5)}):
        with pytest.raises(ValueError, match="lobs"):
            replace(result, extra=extra)


def test_an_unseen_frame_carries_the_hypotheses(name: str, noise: float) -> None:
    (before, state), (unseen, after) = track(name, noise)[MISSING - 1 : MISSING + 1]
    assert unseen.status == "unobserved"
    assert np.array_equal(unseen.q, before.q)
    assert np.array_equal(unseen.weight, before.weight)
    assert unseen.parent.tolist() == list(range(len(before.weight)))
    assert after.time == clip(noise)[MISSING].time > state.time
    for old, new in zip(before.covariance, unseen.covariance, strict=True):
        assert np.linalg.eigvalsh(new - old)[0] > 0.0


def test_frames_before_the_first_usable_one_are_empty(name: str) -> None:
    blank = [replace(clip(NOISE[0])[MISSING], index=i) for i in range(2)]
    results = list(run(tracker(name), [*blank, replace(clip(NOISE[0])[0], index=2)], SEED))
    for result, state in results[:2]:
        assert state is None
        assert result.status == "unobserved"
        assert (result.q.shape, len(result.weight)) == ((0, 35), 0)
    assert results[2][1] is not None
    assert len(results[2][0].weight) >= 1


def test_a_frame_of_nonsense_is_flagged_not_raised(name: str) -> None:
    seen, rng = clip(NOISE[0]), np.random.default_rng(82)
    nonsense = replace(seen[1], pixels=rng.uniform(0.0, 600.0, size=seen[1].pixels.shape))
    results = [r for r, _ in run(tracker(name), [seen[0], nonsense, seen[2]], SEED)]
    assert results[1].status == "hard"
    assert inside(body_of("human34"), results[1].q) or name in UNCONSTRAINED


@pytest.mark.parametrize("name", ["single-mode", "robust-single-mode", "multiple-hypothesis", *PARTICLES])
def test_limits_are_kept_unless_a_tracker_has_none(name: str) -> None:
    """A knee that bends the wrong way: the others stop at the limit, the one without limits follows it."""
    body, free = body_of("human34"), unlimited(body_of("human34"))
    knee = body.q_names.index("left_knee_flexion")
    clip = []
    for i, angle in enumerate((0.05, -0.1, -0.3, -0.5, -0.5)):
        q = free.neutral.copy()
        q[2], q[knee] = 0.95, angle
        clip.append(observe(free, q, [camera_at(0.0), camera_at(90.0)], index=i, time=i / FPS))
    results = [r for r, _ in run(tracker(name), clip, SEED)]
    assert inside(body, results[0].q)
    if name in UNCONSTRAINED:
        assert results[-1].q[0, knee] == pytest.approx(-0.5, abs=0.1)
    else:
        assert all(inside(body, r.q) for r in results)
        if name not in ("condensation", "annealed"):  # so few particles rarely come near it
            assert results[-1].q[0, knee] < body.lower[knee] + 0.1


def test_hypotheses_share_out_the_particles() -> None:
    """Each has the weight of its particles; a single one is the mean and covariance of all particles."""
    body = body_of("human34")
    by_modes = {}
    for modes in (1, 7):
        settings = settings_for("condensation", modes=modes, changes={"condensation": {"particles": 200, "noise": 1.0}})
        *_, (result, state) = run(make_tracker("condensation", body, settings), clip(NOISE[1])[:2], SEED)
        assert state is not None
        shares = np.bincount(state.particles.owner, weights=state.particles.weights)
        assert np.allclose(shares, result.weight, atol=1e-12)
        by_modes[modes] = result, state.particles
    assert len(by_modes[7][0].weight) > 1
    whole, particles = by_modes[1]
    mean, covariance = mean_and_covariance(body, particles.states[:, : body.nq], particles.weights)
    assert np.allclose(mean, whole.q[0], atol=1e-9)
    assert np.allclose(covariance, whole.covariance[0], atol=1e-9)


class Pages:
    """Records what a run writes."""

    def __init__(self) -> None:
        self.pages: list[tuple[FrameResult, dict[str, np.ndarray]]] = []

    def append(self, result: FrameResult, state: dict[str, np.ndarray]) -> None:
        self.pages.append((result, dict(state)))


def test_a_run_is_written_as_it_goes() -> None:
    pages, messages = Pages(), []
    run_into(pages, tracker("single-mode"), clip(NOISE[1]), SEED, progress=lambda done, of: messages.append((done, of)))
    assert messages == [(k + 1, FRAMES) for k in range(FRAMES)]
    for (result, arrays), (expected, state) in zip(pages.pages, track("single-mode", NOISE[1]), strict=True):
        assert same_result(result, expected)
        assert all(np.array_equal(arrays[k], v) for k, v in state.arrays().items())


SWAPPED = range(3, 6)


def swapped_clip() -> list[Observation]:
    mirror = mirror_index(body_of("human34").landmark_names)
    return [o.exchanged(mirror) if o.index in SWAPPED else o for o in clip(NOISE[0]) if o.index != MISSING]


def limb_errors(results: list[FrameResult]) -> np.ndarray:
    body = body_of("human34")
    index = [body.landmark_names.index(n) for n in LIMBS]
    best = np.array([body.landmarks(body.at(r.q[0]))[index] for r in results])
    true = np.array([body.landmarks(body.at(truth()[r.index]))[index] for r in results])
    hips = [LIMBS.index("left_hip"), LIMBS.index("right_hip")]
    aligned = (best - best[:, hips].mean(axis=1, keepdims=True)) - (true - true[:, hips].mean(axis=1, keepdims=True))
    return np.linalg.norm(aligned, axis=2).mean(axis=1)


def test_swapped_sides_are_repaired() -> None:
    """A detector that swaps left and right for some frames: covariance scaled sampling reads them exchanged."""
    results = [r for r, _ in run(tracker("css"), swapped_clip(), SEED)]
    assert [r.association[0] == "exchanged" for r in results] == [r.index in SWAPPED for r in results]
    assert limb_errors(results).max() < 0.12


def test_a_single_mode_takes_keypoints_as_detected() -> None:
    results = [r for r, _ in run(tracker("single-mode"), swapped_clip(), SEED)]
    assert {r.association for r in results[1:]} == {("as_detected",)}
    swapped = np.isin([r.index for r in results], SWAPPED)
    assert limb_errors(results)[swapped].mean() > 2.0 * limb_errors(results)[:3].mean()


def test_settings_by_name() -> None:
    for name in TRACKERS:
        assert settings_for(name, changes=settings_for(name).to_dict()) == settings_for(name)
        if TRACKERS[name].keeps_several:
            assert settings_for(name, modes=3).own.modes == 3
        else:
            with pytest.raises(InputError, match="keeps a single hypothesis"):
                settings_for(name, modes=3)
    changed = settings_for(
        "css", modes=3, changes={"cost": {"nu": 2, "potential": "leclerc"}, "search": {"refine": {"max_iterations": 9}}}
    )
    assert (changed.own.modes, changed.cost.nu, changed.cost.potential) == (3, 2.0, "leclerc")
    assert isinstance(changed.cost.nu, float)
    assert changed.search.refine.max_iterations == 9
    assert changed.search.explore == settings_for("css").search.explore
    assert settings_for("css-paper") != settings_for("css")
    assert settings_for("spherical").own == replace(settings_for("css-paper").own, shape="spherical")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cots": {}}, ("cots", "cost, search, css")),
        ({"cost": {"mu": 1.0}}, ("mu", "potential", "keypoint_noise", "exchange_penalty")),
        ({"search": {"refine": {"iterations": 3}}}, ("settings.search.refine", "iterations", "max_iterations")),
        ({"css": {"modes": 2.5}}, ("settings.css.modes", "2.5", "int")),
        ({"css": {"keep": 1}}, ("settings.css.keep", "bool")),
        ({"cost": {"nu": "wide"}}, ("settings.cost.nu", "wide", "float")),
        ({"cost": {"nu": True}}, ("settings.cost.nu", "True")),
        ({"cost": 3}, ("cost", "table")),
    ],
)
def test_wrong_settings_are_named_with_the_valid_ones(changes: dict[str, object], message: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as error:
        settings_for("css", changes=changes)
    assert all(part in str(error.value) for part in message)


def test_wrong_trackers_are_named_with_the_valid_ones() -> None:
    for wrong in (lambda: settings_for("ccs"), lambda: make_tracker("ccs", body_of("human34"), Settings())):
        with pytest.raises(InputError, match=", ".join(TRACKERS)):
            wrong()
    with pytest.raises(InputError, match="at least 1"):
        settings_for("css", modes=0)


@pytest.mark.parametrize(
    "changes",
    [
        {"cost": {"potential": "huber"}},
        {"cost": {"transition_potential": "huber"}},
        {"css": {"samples": -1}},
        {"css": {"modes": 0}},
        {"cost": {"turn_speed": 0.0}},
        {"cost": {"nu": float("nan")}},
        {"cost": {"nu": -1.0}},
    ],
)
def test_values_that_cannot_work_are_input_errors(changes: dict[str, object]) -> None:
    """The user gets one readable line, whether settings or tracker find the fault."""
    with pytest.raises(InputError):
        list(
            run(make_tracker("css", body_of("human34"), settings_for("css", changes=changes)), clip(NOISE[0])[:2], SEED)
        )
