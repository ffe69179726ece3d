"""Gloss and haze: anchors, closed forms, and brute force in other coordinates than the library's."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import brdfcore as bc
from brdfcore.analysis.gloss.gloss import GLOSS, HAZE, Geometry, gloss
from brdfcore.analysis.gloss.luminance import luminance_weights, photopic
from brdfcore.analysis.gloss.receptor import Rectangle, received
from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import InputError
from brdfcore.base.quadrature import composite, gauss_legendre
from tests.shared import needs_shared, rgl_path
from tests.support.tiers import first_fast

COLLIMATED = [replace(g, source=(0.0, 0.0)) for g in GLOSS]


def values_of(found: Any) -> list[float]:
    return [reading.values[0] for reading in found.gloss.values()]


class Of(Brdf):
    """f from a function of (theta_i, theta_o, delta_phi)."""

    def __init__(self, f: Any, channels: Channels | None = None, **flags: bool) -> None:
        super().__init__()
        self.f = f
        self.channels = channels or self.channels
        for name, value in flags.items():
            setattr(self, name, value)

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        values = np.asarray(self.f(theta_i, theta_o, delta_phi))
        out[...] = values if values.ndim == 2 else values[:, None]
        return True


# ---- anchors and closed forms --------------------------------------------------------------------


def test_the_black_glass() -> None:
    """Fresnel's reflectance of n = 1.567 at 20, 60 and 85 degrees."""
    found = gloss(bc.model("lambert"), geometries=COLLIMATED, haze=None, tolerance=1.0)
    assert [r.reference for r in found.gloss.values()] == pytest.approx([0.049078, 0.100056, 0.619148], abs=5e-7)
    itself = gloss(bc.model("mirror", ior=1.567))
    assert values_of(itself) == pytest.approx([100, 100, 100], abs=1e-9)


@pytest.mark.parametrize("geometries", [GLOSS, COLLIMATED], ids=["standard", "collimated"])
def test_smooth_glass(geometries: Any) -> None:
    found = gloss(bc.model("mirror", ior=1.5168), geometries=geometries, haze=None)
    assert values_of(found) == pytest.approx([86.47, 91.91, 99.27], abs=0.006)
    assert all(r.error == [0.0] and r.of_delta == r.values for r in found.gloss.values())


def polygon_share(corners: np.ndarray) -> float:
    """Flux of a white Lambertian into a spherical polygon: Lambert's sum over the edges (1760), a closed form."""
    unit = corners / np.linalg.norm(corners, axis=1)[:, None]
    total = 0.0
    for a, b in zip(unit, np.roll(unit, -1, axis=0)):
        edge = np.cross(a, b)
        total += np.arctan2(np.linalg.norm(edge), a @ b) * edge[2] / np.linalg.norm(edge)
    return abs(total) / (2 * np.pi)


def test_white_lambertian() -> None:
    found = gloss(bc.model("lambert", reflectance=1.0), geometries=COLLIMATED, haze=None, tolerance=1e-4)
    assert values_of(found) == pytest.approx([1.2025, 2.485, 0.0327], abs=6e-4)
    for geometry, reading in zip(COLLIMATED, found.gloss.values()):
        rectangle = Rectangle(np.radians(geometry.theta), *np.radians(geometry.receptor))
        exact = 100 * polygon_share(rectangle.corners[[0, 1, 3, 2]]) / reading.reference
        assert reading.values[0] == pytest.approx(exact, abs=2e-4)
        assert abs(reading.values[0] - exact) <= 3 * reading.error[0] + 1e-9


@pytest.mark.parametrize("light", [0.0, 0.4, 1.2, 1.5])
@pytest.mark.parametrize("aside", [0.0, 0.7])
def test_any_aperture_of_a_lambertian(light: float, aside: float) -> None:
    """Whole, beside and around the mirror direction: the limits over the half vector are those of the rectangle."""
    wi = np.array([np.sin(light) * np.cos(aside), np.sin(light) * np.sin(aside), np.cos(light)])
    for rectangle in (Rectangle(0.3, 0.2, 0.5), Rectangle(1.1, 0.4, 0.2), Rectangle(-0.4, 0.05, 0.3)):
        flux, _ = received(bc.model("lambert", reflectance=1.0), wi, rectangle, 32, 12)
        # beside the mirror direction a ray may touch a side of the rectangle: a square root in azimuth
        assert flux[0] == pytest.approx(polygon_share(rectangle.corners[[0, 1, 3, 2]]), rel=1e-6)


@given(
    light=st.floats(0.0, 1.55),
    aside=st.floats(-3.0, 3.0),
    centre=st.floats(-1.2, 1.2),
    along=st.floats(0.01, 0.5),
    across=st.floats(0.01, 0.5),
)
@settings(max_examples=40, deadline=None)
def test_apertures_anywhere(light: float, aside: float, centre: float, along: float, across: float) -> None:
    """Every light, every rectangle above the horizon: Lambert's closed form."""
    wi = np.array([np.sin(light) * np.cos(aside), np.sin(light) * np.sin(aside), np.cos(light)])
    rectangle = Rectangle(centre, along, across)
    flux, _ = received(bc.model("lambert", reflectance=1.0), wi, rectangle, 24, 10)
    assert flux[0] == pytest.approx(polygon_share(rectangle.corners[[0, 1, 3, 2]]), rel=1e-4)


def test_an_aperture_cut_by_the_horizon() -> None:
    """Half of a rectangle centred on the horizon: of equal f cos_o the closed form of its upper half."""
    below = Rectangle(np.pi / 2, 0.2, 0.3)
    flux, _ = received(bc.model("lambert", reflectance=1.0), np.array([np.sin(1.0), 0, np.cos(1.0)]), below, 32, 24)
    corners = below.corners.copy()[[0, 1, 3, 2]]
    corners[corners[:, 2] < 0, 2] = 0.0
    assert flux[0] == pytest.approx(polygon_share(corners), rel=1e-5)


# ---- sharp lobes, against brute force in the tangent plane ---------------------------------------


def tangent_plane(b: Brdf, geometry: Geometry, sources: int, panels: int) -> FloatArray:
    """The reading by integration over the receptor's tangent plane, graded to each mirror image; no half vector."""
    theta = np.radians(geometry.theta)
    s, c = np.sin(theta), np.cos(theta)
    mirror, e_x, e_y = np.array([-s, 0, c]), np.array([-c, 0, -s]), np.array([0.0, 1.0, 0.0])
    towards, l_x = np.array([s, 0, c]), np.array([c, 0, -s])
    width, height = (np.tan(np.radians(a) / 2) for a in geometry.receptor)
    ends = [np.tan(np.radians(a) / 2) for a in geometry.source]
    nodes = [gauss_legendre(sources, -e, e) if e else (np.zeros(1), np.ones(1)) for e in ends]
    total, norm = np.zeros(len(b.channels)), 0.0
    for x0, w0 in zip(*nodes[0]):
        for y0, w1 in zip(*nodes[1]):
            wi = towards + x0 * l_x + y0 * e_y
            x, w_x = graded(x0, width, panels)
            y, w_y = graded(-y0, height, panels)
            wo = mirror + x[:, None, None] * e_x + y[None, :, None] * e_y
            length = np.linalg.norm(wo, axis=-1)
            f = b.evaluate_vectors(wi, wo)
            weight = w_x[:, None] * w_y / length**3 * (wo[..., 2] / length)
            share = w0 * w1 / np.linalg.norm(wi) ** 3
            total += share * np.einsum("ij,ijc->c", weight, f)
            norm += share
    return total / norm


def graded(centre: float, end: float, panels: int) -> tuple[FloatArray, FloatArray]:
    """Nodes over [-end, end] whose panels shrink towards `centre` to a ten-thousandth."""
    steps = np.geomspace(1e-4, 1.0, panels)
    edges = np.concatenate([centre - (centre + end) * steps[::-1], [centre], centre + (end - centre) * steps])
    return composite(edges, 8)


@pytest.mark.parametrize("geometry", GLOSS, ids=lambda g: g.name)
def test_a_lobe_far_narrower_than_the_receptor(geometry: Geometry) -> None:
    """m = .001: a thousandth of the receptor's width across, to .01 GU."""
    b = bc.model("ggx", roughness=0.001, ior=1.5)
    found = gloss(b, geometries=[geometry], haze=None, tolerance=0.005).gloss[geometry.name]
    brute = 100 * tangent_plane(b, geometry, 5, 14) / found.reference
    assert found.values == pytest.approx(brute, abs=0.01)
    assert found.converged
    assert found.error[0] <= 0.005


@pytest.mark.parametrize("roughness", first_fast(1e-4, 1e-6))
def test_lobes_become_a_mirror(roughness: float) -> None:
    """The flux that a mirror's image would bring, less a tail of the order of the squared roughness."""
    b = bc.model("cook_torrance", roughness=roughness, ior=1.5168, distribution="beckmann")
    assert values_of(gloss(b, haze=None)) == pytest.approx([86.47, 91.91, 99.27], abs=0.02)


@needs_shared
@pytest.mark.shared
@pytest.mark.parametrize("index", first_fast(0, 2))
def test_a_sharp_measurement(index: int) -> None:
    """To .1 GU of brute force on a plain grid, which has no other idea of where the lobe is; of 820 GU."""
    b = bc.read(rgl_path("chm_light_blue"))
    geometry = COLLIMATED[index]
    found = gloss(b, geometries=[geometry], haze=None).gloss[geometry.name]
    s, c = np.sin(np.radians(geometry.theta)), np.cos(np.radians(geometry.theta))
    n = 1200
    width, height = (np.tan(np.radians(a) / 2) for a in geometry.receptor)
    x, y = (end * ((2 * np.arange(n) + 1) / n - 1) for end in (width, height))
    total = np.zeros(3)
    for part in np.array_split(x, 8):
        wo = np.array([-s, 0, c]) + part[:, None, None] * np.array([-c, 0, -s]) + y[:, None] * np.array([0.0, 1.0, 0.0])
        length = np.linalg.norm(wo, axis=-1)
        f = b.evaluate_vectors(np.array([s, 0.0, c]), wo)
        total += np.einsum("ijc,ij->c", f, wo[..., 2] / length**4)
    brute = 100 * total * (2 * width / n) * (2 * height / n) / found.reference
    assert found.values == pytest.approx(brute, abs=0.1)
    assert max(found.error) <= 0.1


# ---- haze, delta, channels -----------------------------------------------------------------------


def test_haze() -> None:
    b = bc.model("ggx", roughness=0.01, ior=1.5, specular=0.8, diffuse=0.2)
    found = gloss(b)
    index = found.haze["astm_d4039"]
    assert index["values"] == pytest.approx([found.gloss["60"].values[0] - found.gloss["20"].values[0]])
    beside = found.haze["astm_e430"]
    brute = sum(
        # each haze receptor in its own tangent plane, the source a single direction
        100 * received(b, np.array([np.sin(t), 0, np.cos(t)]), Rectangle(t + o, *np.radians((1.8, 5.5))), 24, 24)[0][0]
        for t, o in ((np.radians(20.0), np.radians(1.9)), (np.radians(20.0), -np.radians(1.9)))
    )
    collimated = gloss(b, geometries=COLLIMATED[:1], haze=replace(HAZE, source=(0.0, 0.0))).haze["astm_e430"]
    assert collimated["values"][0] == pytest.approx(brute / found.gloss["20"].reference, abs=2e-3)
    assert beside["values"][0] > 5
    sharper = gloss(bc.model("ggx", roughness=0.001, ior=1.5), geometries=GLOSS[:1]).haze["astm_e430"]["values"][0]
    assert sharper < 1
    assert gloss(bc.model("mirror", ior=1.5), geometries=GLOSS[:1]).haze["astm_e430"]["values"] == [0.0]


def test_haze_needs_its_angle() -> None:
    found = gloss(bc.model("lambert"), geometries=[Geometry("45", 45.0)])
    assert found.haze == {}
    assert found.standards == []


def test_a_mirror_part_counts_as_far_as_its_image_is_seen() -> None:
    half = bc.model("mirror", reflectance=0.5)
    both = half + bc.model("lambert", reflectance=0.2)
    alone, sum_ = gloss(half, haze=None), gloss(both, haze=None)
    diffuse = gloss(bc.model("lambert", reflectance=0.2), haze=None)
    assert values_of(sum_) == pytest.approx(np.add(values_of(alone), values_of(diffuse)), rel=1e-12)
    assert sum_.gloss["60"].of_delta == alone.gloss["60"].values
    # a receptor turned by half its width sees the half of the image beyond the mirror direction
    turned = Geometry("turned", 20.0, receptor=(1.8, 3.6), offsets=(0.9,))
    reading = gloss(half, geometries=GLOSS, haze=turned).haze["astm_e430"]
    assert reading["of_delta"][0] == pytest.approx(0.5 * alone.gloss["20"].values[0], rel=1e-5)


def test_channels_and_luminance() -> None:
    rgb = bc.model("lambert", reflectance=[0.8, 0.4, 0.2])
    found = gloss(rgb, geometries=COLLIMATED, haze=None)
    white = values_of(gloss(bc.model("lambert", reflectance=1.0), geometries=COLLIMATED, haze=None))
    for reading, one in zip(found.gloss.values(), white):
        assert reading.values == pytest.approx([0.8 * one, 0.4 * one, 0.2 * one])
        assert reading.luminance == pytest.approx((0.2126 * 0.8 + 0.7152 * 0.4 + 0.0722 * 0.2) * one)
    names = Channels(("one", "two"))
    unknown = gloss(Of(lambda i, o, d: np.ones((i.size, 2)), names), geometries=COLLIMATED, haze=None)
    assert unknown.gloss["20"].luminance is None
    assert "no known luminance" in unknown.luminance_of
    nm = Channels([float(x) for x in np.linspace(360, 1000, 65)])
    flat = gloss(Of(lambda i, o, d: np.full((i.size, 65), 0.3 / np.pi), nm), geometries=COLLIMATED, haze=None)
    assert flat.gloss["60"].luminance == pytest.approx(flat.gloss["60"].values[0])
    json.dumps([unknown.to_json(), flat.to_json()], allow_nan=False)


def test_the_eye() -> None:
    """V(lambda): 1 at 555 nm, half at 510 and 610 nm to a hundredth, nothing in the infrared; RGB in any order."""
    assert photopic(np.array([555.0, 510.0, 610.0, 1000.0])) == pytest.approx([1.0, 0.503, 0.503, 0.0], abs=0.015)
    weights, _ = luminance_weights(Channels(("B", "G", "R")))
    assert weights is not None
    assert weights.tolist() == [0.0722, 0.7152, 0.2126]
    assert luminance_weights(Channels([900.0, 1000.0]))[0] is None
    weights, _ = luminance_weights(Channels([600.0, 500.0, 550.0]))
    assert weights is not None
    assert weights.sum() == pytest.approx(1)
    assert weights.argmax() == 2


def test_without_bilateral_symmetry() -> None:
    """Both sides of the plane of incidence are integrated: a lobe on one of them counts the same on either."""

    def skewed(sign: float) -> Brdf:
        return Of(lambda i, o, d: 1 + 0.5 * sign * np.sin(d) * np.sin(o) * np.sin(i), bilateral=False)

    a, b = (gloss(skewed(s), geometries=GLOSS[:2], haze=None) for s in (1.0, -1.0))
    plain = gloss(Of(lambda i, o, d: np.ones_like(i)), geometries=GLOSS[:2], haze=None)
    assert values_of(a) == pytest.approx(values_of(b), rel=1e-9)
    assert values_of(a) == pytest.approx(values_of(plain), rel=1e-5)  # what is odd in delta_phi cancels


# ---- limits and hostile options ------------------------------------------------------------------


def test_the_error_shrinks_with_the_tolerance_and_the_budget_ends_it() -> None:
    rough = Of(lambda i, o, d: np.abs(np.sin(3000 * o)) / np.cos(o))  # kinks everywhere
    loose = gloss(rough, geometries=COLLIMATED[:1], haze=None, tolerance=1e6).gloss["20"]
    tight = gloss(rough, geometries=COLLIMATED[:1], haze=None, tolerance=1e-9, budget=3_000_000).gloss["20"]
    assert loose.evaluations < tight.evaluations
    assert loose.converged
    assert not tight.converged
    assert tight.error[0] < loose.error[0]
    assert abs(tight.values[0] - loose.values[0]) <= loose.error[0] + tight.error[0]
    starved = gloss(rough, geometries=COLLIMATED[:1], haze=None, tolerance=1e-9, budget=1).gloss["20"]
    assert starved.evaluations < tight.evaluations
    assert np.isfinite(starved.error[0])


def test_values_that_are_not_finite() -> None:
    found = gloss(Of(lambda i, o, d: np.where(o > np.radians(20), np.nan, 1.0)))
    assert not found.gloss["20"].converged
    content = json.loads(json.dumps(found.to_json(), allow_nan=False))
    assert content["gloss"]["20"]["values"] == [None]
    assert content["haze"]["astm_d4039"]["luminance"] is None


@pytest.mark.parametrize(
    "geometry",
    [
        {"theta": -1.0},
        {"theta": 90.0},
        {"theta": 89.8},
        {"theta": float("nan")},
        {"theta": "20"},
        {"theta": True},
        {"source": (0.75,)},
        {"source": 0.75},
        {"source": (0.75, -1.0)},
        {"receptor": (0.0, 1.0)},
        {"receptor": (1.0, 1e9)},
        {"offsets": ()},
        {"offsets": (0.0,) * 9},
        {"offsets": (float("inf"),)},
    ],
    ids=str,
)
def test_geometries_that_cannot_be(geometry: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        Geometry(**{"name": "x", "theta": 20.0, **geometry})
    assert caught.value.code == "bad_geometry"
    assert caught.value.context["where"] in ("theta", "source", "receptor", "offsets")


@pytest.mark.parametrize(
    "options",
    [
        {"tolerance": 0},
        {"tolerance": float("nan")},
        {"tolerance": "x"},
        {"budget": 0},
        {"budget": 1.5},
        {"budget": 10**30},
        {"reference_ior": 1.0},
        {"reference_ior": 1 + 2j},
        {"geometries": []},
        {"geometries": [GLOSS[0], GLOSS[0]]},
        {"geometries": [Geometry("blind", 20.0, offsets=(10.0,))]},
    ],
    ids=str,
)
def test_options_that_cannot_be(options: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        gloss(bc.model("lambert"), **{"haze": None, **options})
