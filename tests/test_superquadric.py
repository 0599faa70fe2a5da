"""Laws of superquadrics: implicit form, closed forms, derivatives, normals, volume."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import beta

from humanoid.shape.flesh import grid_nodes
from humanoid.subject import superquadric
from humanoid.subject.superquadric import derivatives, fault, largest_bend, normals, points
from humanoid.subject.urdf_flesh import Flesh

CASES = range(40)
NEUTRAL = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0])


def shape(seed: int, *, bent: bool = True) -> np.ndarray:
    """Random valid parameters (9,)."""
    rng = np.random.default_rng(seed)
    p = np.concatenate(
        [rng.uniform(0.03, 0.3, 3), rng.uniform(0.3, 1.7, 2), rng.uniform(-0.7, 0.7, 2), rng.normal(size=2)]
    )
    p[7:] *= rng.uniform(0.0, 0.95) * largest_bend(p) / np.hypot(*p[7:]) if bent else 0.0
    assert fault(p) is None
    return p


def places(seed: int, count: int = 200) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.stack([rng.uniform(-1.5, 1.5, count), rng.uniform(-3.1, 3.1, count)], axis=-1)


def central(f, x: np.ndarray, k: int, step: float = 1e-6) -> np.ndarray:  # type: ignore[no-untyped-def]
    ahead, behind = x.copy(), x.copy()
    ahead[..., k] += step
    behind[..., k] -= step
    return (f(ahead) - f(behind)) / (2.0 * step)


@pytest.mark.parametrize("seed", CASES)
def test_undeformed_points_satisfy_the_implicit_form(seed: int) -> None:
    p = np.concatenate([shape(seed)[:5], np.zeros(4)])
    a, b, c, e1, e2 = p[:5]
    x, y, z = np.abs(points(p, places(seed)).T)
    inside_outside = ((x / a) ** (2 / e2) + (y / b) ** (2 / e2)) ** (e2 / e1) + (z / c) ** (2 / e1)
    np.testing.assert_allclose(inside_outside, 1.0, rtol=1e-12)


def test_exponents_of_one_give_an_ellipsoid() -> None:
    radii, u = np.array([0.1, 0.2, 0.3]), places(0)
    p = np.concatenate([radii, NEUTRAL])
    sphere = np.stack([np.cos(u[:, 0]) * np.cos(u[:, 1]), np.cos(u[:, 0]) * np.sin(u[:, 1]), np.sin(u[:, 0])], axis=-1)
    np.testing.assert_allclose(points(p, u), radii * sphere, atol=1e-15)
    gradient = sphere / radii
    np.testing.assert_allclose(normals(p, u), gradient / np.linalg.norm(gradient, axis=1, keepdims=True), atol=1e-14)


@pytest.mark.parametrize("seed", CASES)
def test_derivatives_are_central_differences(seed: int) -> None:
    p, u = shape(seed), places(seed)
    for k in range(9):
        difference = central(lambda q: points(q, u), p, k)
        np.testing.assert_allclose(derivatives(p, u)[:, :, k], difference, atol=3e-9, err_msg=superquadric.NAMES[k])


@pytest.mark.parametrize("curvature", [0.0, 1e-9, 1e-4, 0.2, 0.3333, 0.34])
def test_bending_is_smooth_through_zero_curvature(curvature: float) -> None:
    """The series and the closed forms agree at |k| z = 0.1, here |k| = 1/3."""
    p, u = np.concatenate([[0.05, 0.04, 0.3], NEUTRAL]), places(1)
    p[7:] = curvature * np.array([0.6, -0.8])
    for k in (7, 8):
        np.testing.assert_allclose(derivatives(p, u)[:, :, k], central(lambda q: points(q, u), p, k), atol=1e-9)
    bent = points(p, u)
    z = points(np.concatenate([p[:7], [0.0, 0.0]]), u)[:, 2]
    if curvature == 0.2:  # the axis of a thin part is an arc of that radius through the origin
        thin = points(np.concatenate([[1e-9, 1e-9], p[2:]]), u)
        centre = np.array([0.6, -0.8, 0.0]) / curvature
        np.testing.assert_allclose(np.linalg.norm(thin - centre, axis=1), 1.0 / curvature, atol=1e-8)
        np.testing.assert_allclose(thin[:, 2], np.sin(curvature * z) / curvature, atol=1e-8)
    assert np.isfinite(bent).all()


@pytest.mark.parametrize("seed", CASES)
def test_normals_are_perpendicular_to_the_tangents_and_point_out(seed: int) -> None:
    p, u = shape(seed), places(seed)
    n = normals(p, u)
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0, atol=1e-12)
    for k in range(2):
        tangent = central(lambda v: points(p, v), u, k)
        length = np.linalg.norm(tangent, axis=1)
        assert (np.abs(np.einsum("ni,ni->n", n, tangent))[length > 1e-4] < 1e-5 * length[length > 1e-4]).all()
    # growing all radii and straightening nothing moves every point outwards
    grown = np.einsum("nik,k->ni", derivatives(p, u)[:, :, :3], p[:3])
    jacobian = superquadric.deformation_jacobian(p, points(np.concatenate([p[:5], np.zeros(4)]), u))
    assert (np.linalg.det(jacobian) > 0.0).all()
    assert np.einsum("ni,ni->n", n, grown).mean() > 0.0


def volume(p: np.ndarray) -> float:
    """Closed form: the superquadric's (Jaklic, Leonardis, Solina 2000), with the even part of the two tapers."""
    a, b, c, e1, e2, tx, ty = p[:7]
    section = 2.0 * a * b * e2 * beta(e2 / 2 + 1, e2 / 2)
    # sections have the area section (1 - s^(2/e1))^e1 (1 + tx s)(1 + ty s) at z = c s
    zeroth, second = (e1 * beta(e1 * (k + 1) / 2, e1 + 1) for k in (0, 2))
    return float(section * c * (zeroth + tx * ty * second))


@pytest.mark.parametrize("seed", range(15))
def test_volume_by_the_divergence_theorem(seed: int) -> None:
    """Closed meshes, counter-clockwise from outside; bending keeps the volume."""
    p = shape(seed)
    size = (float(p[0]), float(p[1]), float(p[2]))
    part = Flesh("part", "superquadric", size, (0, 0, 0), (0, 0, 0)).with_parameters(p)
    u, faces = grid_nodes(part, 120, 120)
    x = points(p, u)[faces]
    enclosed = np.einsum("fi,fi->f", x[:, 0], np.cross(x[:, 1], x[:, 2])).sum() / 6.0
    assert enclosed == pytest.approx(volume(p), rel=4e-3)


def test_poles_and_edges_of_the_domain_are_finite() -> None:
    u = np.array([[s * np.pi / 2, w] for s in (-1, 0, 1) for w in (-np.pi, -np.pi / 2, 0.0, np.pi / 2, np.pi)])
    for seed in CASES:
        p = shape(seed)
        for arrays in (points(p, u), normals(p, u), derivatives(p, u)):
            assert np.isfinite(arrays).all()
        assert normals(p, u)[-1] @ (points(p, u)[-1] - points(p, u)[0]) > 0.0


@pytest.mark.parametrize(
    ("index", "value", "message"),
    [
        (0, 0.0, "not positive"),
        (2, np.nan, "finite"),
        (3, 0.05, "exponents"),
        (4, 2.1, "exponents"),
        (5, 1.0, "taper"),
        (7, 6.0, "folds"),
        (8, -9.0, "folds"),
    ],
)
def test_faults_are_reported(index: int, value: float, message: str) -> None:
    p = np.array([0.1, 0.1, 0.3, 0.8, 1.0, 0.2, 0.2, 0.5, 0.0])
    assert fault(p) is None
    p[index] = value
    problem = fault(p)
    assert problem is not None
    assert message in problem[0]


def test_mirror_parameters_give_the_mirror_image() -> None:
    p, u = shape(3), places(3)
    mirrored = points(p * superquadric.MIRROR, u * [1.0, -1.0])
    np.testing.assert_allclose(mirrored, points(p, u) * [1.0, -1.0, 1.0], atol=1e-15)


def folds(p: np.ndarray, u: np.ndarray) -> bool:
    """Whether bending turns a part inside out somewhere, or bends its end beyond a right angle."""
    x = points(np.concatenate([p[:5], np.zeros(4)]), u)
    inside_out = np.linalg.det(superquadric.deformation_jacobian(p, x)).min() <= 0.0
    return bool(inside_out or np.abs(x[:, 2]).max() * np.hypot(*p[7:]) >= np.pi / 2)


def test_the_largest_bend_does_not_fold() -> None:
    """Sections, which bending turns about their centre of curvature, stay in order all along the part."""
    beyond = []
    for seed in CASES:
        p = shape(seed)
        p[7:] *= 0.999 * largest_bend(p) / np.hypot(*p[7:])
        u = places(seed, 500)
        assert not folds(p, u)
        x = points(np.concatenate([p[:7], [0, 0]]), u)
        assert (1.0 - x[:, :2] @ p[7:] > 0.09).all()
        p[7:] *= 3.0
        beyond.append(folds(p, u))
    assert sum(beyond) > len(CASES) // 2  # thrice as much folds most of them
