"""Lambert, mirror, Cook-Torrance and the microfacet parts: values, flags, energy, parameters.

Values come from closed forms, published tables and other programs, each named where it is used; agreement with
mpmath over hard cases is in test_hard_cases.py.
"""

from __future__ import annotations

import itertools
import json
import math
import subprocess
import sys
import warnings
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import brdfcore as bc
from brdfcore.base.channels import RGB
from brdfcore.base.errors import InputError, MissingExtraError, UnknownNameError
from brdfcore.models.base import microfacet
from brdfcore.models.cook_torrance import CookTorrance
from brdfcore.models.lambert import Lambert
from brdfcore.models.mirror import Mirror
from tests.support.tiers import first_fast

DISTRIBUTIONS = ("beckmann", "blinn", "gaussian", "ggx")
LOBES = [(d, "vgroove") for d in DISTRIBUTIONS] + [("beckmann", "smith"), ("ggx", "smith")]
HALF_PI = np.pi / 2
#: Accurate to 1e-6 for every lobe below; `albedo`'s default is chosen for speed.
FINE = {"points": 24, "azimuths": 256}


def one(distribution: str, m: float) -> microfacet.Distribution:
    return microfacet.DISTRIBUTIONS[distribution](np.array([m]))


# ---- lambert and mirror ----------------------------------------------------------------------------


def test_lambert_is_reflectance_over_pi_and_reflects_it() -> None:
    b = Lambert(reflectance=[0.2, 0.5, 1.0])
    assert b.channels == RGB
    assert not b.has_delta
    assert b.energy_conserving
    assert b.reciprocal
    np.testing.assert_allclose(b.evaluate(0.3, [0.1, HALF_PI], 2.0), np.tile([0.2, 0.5, 1.0], (2, 1)) / np.pi)
    np.testing.assert_allclose(b.albedo([0.0, 1.2]), np.tile([0.2, 0.5, 1.0], (2, 1)), rtol=1e-6)
    assert b.evaluate_vectors([0, 0, 1], [[0, 0.6, 0.8], [0, 0.6, -0.8]])[1].tolist() == [0, 0, 0]


@pytest.mark.parametrize("reflectance", [-0.1, 1.1, float("nan"), "white", [[0.5]]])
def test_lambert_refuses_what_is_no_reflectance(reflectance: Any) -> None:
    with pytest.raises(InputError, match="reflectance"):
        Lambert(reflectance=reflectance)


def test_mirror_is_a_delta_and_nothing_else() -> None:
    b = Mirror(reflectance=[0.9, 0.8, 0.7])
    assert b.has_delta
    assert (b.evaluate(0.5, 0.5, np.pi) == 0).all()
    assert b.evaluate(0.5, 0.5, np.pi).shape == (3,)
    np.testing.assert_array_equal(b.delta_reflectance([0.0, 1.5]), [[0.9, 0.8, 0.7]] * 2)
    np.testing.assert_array_equal(b.albedo(1.0), [0.9, 0.8, 0.7])
    assert Mirror().delta_reflectance(0.3).tolist() == [1.0]


def test_mirror_of_a_material_reflects_by_fresnel() -> None:
    """Closed forms: ((n-1)/(n+1))^2 = .04 for n = 1.5 and ((n-1)^2+k^2)/((n+1)^2+k^2) for gold, at normal incidence."""
    assert Mirror(ior=1.5).delta_reflectance(0.0)[0] == pytest.approx(0.04, rel=1e-14)
    gold = ((0.37 - 1) ** 2 + 2.82**2) / ((0.37 + 1) ** 2 + 2.82**2)
    assert Mirror(ior="gold").delta_reflectance(0.0)[0] == pytest.approx(gold, rel=1e-14)
    assert Mirror(ior=1.0, exterior_ior=1.5).delta_reflectance(0.8)[0] == 1  # past 41.8 degrees, from inside
    for horizon in (HALF_PI, np.float32(HALF_PI)):
        assert Mirror(ior=1.5).delta_reflectance(horizon) == pytest.approx(1, abs=1e-15)
    np.testing.assert_array_equal(Mirror(ior=["gold", 1.5, "water"]).delta_reflectance([0, 1]).shape, (2, 3))


def test_mirror_takes_reflectance_or_ior() -> None:
    with pytest.raises(InputError, match="both"):
        Mirror(reflectance=0.5, ior=1.5)


# ---- distributions ---------------------------------------------------------------------------------


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("m", [1e-6, 1e-3, 0.03, 0.1, 0.35, 0.5, 1.0, 1.5])
def test_unit_projected_area(distribution: str, m: float) -> None:
    """int D cos theta dw = int D(t^2) 2 pi t/(1 + t^2)^2 dt = 1, over t = tan theta_h from 0 to the horizon."""
    x, w = np.polynomial.legendre.leggauss(40)
    edges = np.log(np.geomspace(1e-9 * m, 1e9, 61))  # in ln t: what lies below and above is less than 1e-17
    half = 0.5 * np.diff(edges)[:, None]
    t = np.exp(edges[:-1, None] + half * (x + 1))
    density = one(distribution, m).density(t * t)[..., 0]
    area = (half * w * density * 2 * np.pi * t * t / (1 + t * t) ** 2).sum()
    assert abs(area - 1) <= 1e-9


#: Dawson's function F(x), Abramowitz & Stegun, Handbook of Mathematical Functions (1964), Table 7.5.
DAWSON = {0.1: 0.0993359924, 0.5: 0.4244363835, 1.0: 0.5380795069}


def test_gaussian_area_follows_dawson_where_the_horizon_is_far_and_not_where_it_is_near() -> None:
    """A = pi m F(m) only if exp(-(theta/m)^2) has died out at the horizon: 2.7e-6 off at m = .5."""

    def off(m: float) -> float:
        return float(1 / one("gaussian", m).scale[0] / (np.pi * m * DAWSON[m]) - 1)

    assert abs(off(0.1)) <= 1e-9
    assert abs(off(0.5)) == pytest.approx(2.7e-6, abs=0.05e-6)
    assert abs(off(1.0)) > 1e-3


@pytest.mark.parametrize("m", [1e-6, 0.1, 0.35, 0.5, 1.0, 3.0])
def test_gaussian_area_is_the_closed_form(m: float) -> None:
    special = pytest.importorskip("scipy.special")
    faddeeva = special.wofz(m + 0.5j * np.pi / m).imag
    area = np.pi * m * (special.dawsn(m) + 0.5 * math.sqrt(np.pi) * math.exp(-((np.pi / (2 * m)) ** 2)) * faddeeva)
    assert 1 / one("gaussian", m).scale[0] == pytest.approx(area, rel=1e-14)


@pytest.mark.parametrize(("distribution", "m"), [("blinn", 1e-6), ("blinn", 0.3), ("blinn", 1.5)])
def test_blinn_falls_to_half_at_its_roughness(distribution: str, m: float) -> None:
    d = one(distribution, m)
    assert d.density(math.tan(m) ** 2)[0] == pytest.approx(0.5 * d.density(0.0)[0], rel=1e-13)


#: Mitsuba 3.9.1, MicrofacetDistribution.eval (scalar_rgb, float32) at theta_h = 0, 5, 20 degrees.
MITSUBA_D = {
    ("beckmann", 0.1): (31.830988, 15.033241, 7.20475e-05),
    ("beckmann", 0.5): (1.2732395, 1.2538234, 0.96124786),
    ("ggx", 0.1): (31.830988, 10.369882, 0.20110993),
    ("ggx", 0.5): (1.2732395, 1.2171344, 0.69765759),
}


@pytest.mark.parametrize(("key", "values"), MITSUBA_D.items())
def test_densities_agree_with_mitsuba(key: tuple[str, float], values: tuple[float, ...]) -> None:
    tan2 = np.tan(np.radians([0, 5, 20])) ** 2
    np.testing.assert_allclose(one(*key).density(tan2)[:, 0], values, rtol=1e-5)


# ---- masking ---------------------------------------------------------------------------------------


def smith_g1(distribution: str, m: float, theta: float) -> float:
    """G of theta with the other direction along the normal, where L = 0: G = 4 cos_i cos_o V."""
    c, s = np.array([math.cos(theta)]), np.array([math.sin(theta)])
    v = microfacet.smith(distribution, np.array([m]), c, np.ones(1), s, np.zeros(1))
    return float(4 * c[0] * v[0])


def test_smith_beckmann_from_the_error_function_table() -> None:
    """At a = 1/(m tan theta) = 1: L = (erf(1) - 1)/2 + e^-1/(2 sqrt(pi)), erf(1) = .8427007929 (A&S Table 7.1)."""
    masked = 1 + (0.8427007929 - 1) / 2 + math.exp(-1) / (2 * math.sqrt(math.pi))
    assert smith_g1("beckmann", 0.5, math.atan(2)) == pytest.approx(1 / masked, rel=1e-9)


@pytest.mark.parametrize("a", [0.05, 0.3, 0.8, 1.2, 1.59])
def test_smith_beckmann_against_walter(a: float) -> None:
    """Walter et al., EGSR 2007, eq. 27: a rational fit, stated to be within .35 %."""
    fit = (3.535 * a + 2.181 * a * a) / (1 + 2.276 * a + 2.577 * a * a)
    assert smith_g1("beckmann", 0.3, math.atan(1 / (0.3 * a))) == pytest.approx(fit, rel=3.5e-3)


@pytest.mark.parametrize(
    ("m", "degrees", "g1"),
    [(0.1, 30, 0.99916816), (0.1, 85, 0.79405928), (0.5, 30, 0.97999197), (0.5, 60, 0.86100179), (0.5, 85, 0.29403743)],
)
def test_smith_ggx_agrees_with_mitsuba(m: float, degrees: float, g1: float) -> None:
    """Mitsuba 3.9.1, MicrofacetDistribution.smith_g1 (scalar_rgb, float32)."""
    assert smith_g1("ggx", m, math.radians(degrees)) == pytest.approx(g1, rel=2e-6)


@pytest.mark.parametrize("distribution", ["blinn", "gaussian"])
def test_smith_is_refused_where_it_is_not_known(distribution: str) -> None:
    with pytest.raises(InputError, match="smith"):
        CookTorrance(distribution=distribution, masking="smith")


def test_smith_beckmann_without_scipy_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "scipy.special", None)
    with pytest.raises(MissingExtraError, match=r"brdf-tables\[core\]"):
        CookTorrance(masking="smith")
    assert CookTorrance(masking="smith", distribution="ggx").evaluate(0.1, 0.2, 3.0)[0] > 0


# ---- energy ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("convention", "albedo"), [("normalised", 1.0), ("slides", 4 / math.pi), ("published", 4.0)])
@pytest.mark.parametrize("m", [1e-3, 1e-2, 0.1])
def test_albedo_of_a_sharp_lobe_by_convention(convention: str, albedo: float, m: float) -> None:
    """F = 1, theta_i = 0, masking negligible: the reflectance is that of a mirror, 4/pi or 4 times over as printed."""
    b = CookTorrance(roughness=m, convention=convention)
    assert b.albedo(0.0)[0] == pytest.approx(albedo, rel=1e-4)
    assert b.energy_conserving == (convention == "normalised")


def test_conventions_differ_by_4_over_pi_and_4() -> None:
    angles = (np.array([0.2, 0.8, 1.5]), np.array([0.3, 0.7, 1.4]), np.array([3.0, 2.9, 3.1]))
    f = {c: CookTorrance(roughness=0.2, convention=c).evaluate(*angles) for c in ("normalised", "slides", "published")}
    assert (f["normalised"] > 0).all()
    np.testing.assert_allclose(f["slides"] / f["normalised"], 4 / math.pi, rtol=1e-15)
    np.testing.assert_allclose(f["published"] / f["normalised"], 4, rtol=1e-15)


@pytest.mark.parametrize(("distribution", "masking"), LOBES)
@pytest.mark.parametrize("m", first_fast(0.5, 1e-3, 0.1, 1.0, 1.5))
def test_white_furnace(distribution: str, masking: str, m: float) -> None:
    """F = 1 reflects at most what arrives, at every angle: masking and normalisation belong together."""
    b = CookTorrance(roughness=m, distribution=distribution, masking=masking)
    assert b.energy_conserving
    albedo = b.albedo([0.0, 0.7, 1.3, 1.5, HALF_PI], **FINE)
    assert (albedo <= 1 + 1e-6).all()
    assert (albedo > 0.05).all()


@pytest.mark.parametrize("m", [0.1, 0.5, 1.0])
def test_albedo_without_masking_has_closed_forms_at_normal_incidence(m: float) -> None:
    """int D cos theta_h dw over theta_h < 45 deg: 1 - exp(-1/m^2) for Beckmann, 1/(1 + m^2) for GGX."""
    got = [CookTorrance(roughness=m, distribution=d, masking="none").albedo(0.0)[0] for d in ("beckmann", "ggx")]
    assert got == pytest.approx([-math.expm1(-1 / m**2), 1 / (1 + m * m)], rel=1e-7)


def test_no_masking_creates_light_at_grazing_incidence() -> None:
    """The numerics notes' 16.7 is Beckmann m = .1 at 89.9 degrees; nearer the horizon it grows without bound."""
    b = CookTorrance(roughness=0.1, masking="none")
    assert not b.energy_conserving
    assert b.albedo(math.radians(89.9), **FINE)[0] == pytest.approx(16.7, abs=0.05)
    assert b.albedo(math.radians(89.99), **FINE)[0] > 100


def test_diffuse_and_specular_share_the_light() -> None:
    b = CookTorrance(diffuse=0.7, specular=0.3, roughness=0.1)
    assert b.albedo(0.0)[0] == pytest.approx(1.0, abs=1e-4)
    for d in np.arange(1, 100):  # two decimals that add to 1 may add to a little more in binary
        CookTorrance(diffuse=d / 100, specular=(100 - d) / 100)
    with pytest.raises(InputError, match=r"diffuse \+ specular = 1.01"):
        CookTorrance(diffuse=0.01)
    with pytest.raises(InputError, match=r"diffuse \+ specular"):
        CookTorrance(diffuse=[0.1, 0.2, 0.6], specular=0.5)
    with pytest.warns(UserWarning, match=r"diffuse \+ specular"):
        CookTorrance(diffuse=0.01, masking="none")
    with pytest.warns(UserWarning, match=r"diffuse \+ specular"):
        CookTorrance(specular=1.2, convention="slides")


def test_flags() -> None:
    for distribution, masking in LOBES:
        b = CookTorrance(distribution=distribution, masking=masking, ior="gold")
        assert (b.energy_conserving, b.reciprocal, b.bilateral, b.non_negative, b.has_delta) == (True,) * 4 + (False,)


# ---- parameters ------------------------------------------------------------------------------------


def test_lists_are_one_value_per_channel() -> None:
    angles = (np.array([0.2, 0.8]), np.array([0.3, 0.7]), np.array([3.0, 2.9]))
    lists: dict[str, list[Any]] = {
        "diffuse": [0.0, 0.1, 0.2],
        "specular": [0.5, 0.6, 0.7],
        "roughness": [0.1, 0.2, 0.3],
        "ior": ["gold", 1.5, (2.485, 3.433)],
        "exterior_ior": [1.0, 1.333, 1.1],
    }
    for masking, distribution in itertools.product(("vgroove", "smith", "none"), ("beckmann", "ggx")):
        kept = {"masking": masking, "distribution": distribution}
        together = CookTorrance(**lists, **kept)
        assert together.channels == RGB
        got = together.evaluate(*angles)
        for k in range(3):
            single = CookTorrance(**{name: values[k] for name, values in lists.items()}, **kept)
            np.testing.assert_allclose(got[:, k], single.evaluate(*angles)[:, 0], rtol=1e-14)
    assert len(CookTorrance(ior=[0.37, 2.82]).channels) == 2
    with pytest.raises(InputError, match="channels"):
        CookTorrance(roughness=[0.1, 0.2], ior=[1.4, 1.5, 1.6])


def test_alpha_is_the_roughness() -> None:
    assert CookTorrance(alpha=0.2).evaluate(0.1, 0.2, 3.0) == CookTorrance(roughness=0.2).evaluate(0.1, 0.2, 3.0)
    with pytest.raises(InputError, match="twice"):
        CookTorrance(alpha=0.2, roughness=0.2)


def test_fresnel_is_chosen_and_applied() -> None:
    mirror_angle = (0.6, 0.6, np.pi)
    white = CookTorrance(roughness=0.1).evaluate(*mirror_angle)[0]
    for chosen in ({"ior": "gold"}, {"ior": 1.5}, {"ior": 1.5, "exterior_ior": 1.333}):
        auto = CookTorrance(roughness=0.1, **chosen)
        assert auto.metadata["fresnel"] == ("conductor" if chosen["ior"] == "gold" else "dielectric")
        want = Mirror(**chosen).delta_reflectance(0.6)[0]  # at the mirror direction theta_d = theta_i
        assert auto.evaluate(*mirror_angle)[0] / white == pytest.approx(want, rel=1e-14)
    assert CookTorrance(roughness=0.1, fresnel="none", ior="gold").evaluate(*mirror_angle)[0] == white


BAD: list[dict[str, Any]] = [
    {"roughness": 0},
    {"roughness": -0.1},
    {"roughness": float("nan")},
    {"roughness": 1e-9},
    {"roughness": "rough"},
    {"distribution": "phong"},
    {"masking": "v-groove"},
    {"fresnel": "exact"},
    {"fresnel": "conductor"},
    {"fresnel": "dielectric", "ior": "gold"},
    {"ior": -1.5},
    {"convention": "1982"},
    {"diffuse": -0.1},
    {"distribution": "blinn", "roughness": 1.6},
    {"exterior_ior": 0},
]


@pytest.mark.parametrize("parameters", BAD, ids=str)
def test_errors_name_the_parameter(parameters: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        CookTorrance(**parameters)
    where = caught.value.context["where"]
    assert where in parameters or (where == "ior" and parameters == {"fresnel": "conductor"})


def test_unknown_names() -> None:
    with pytest.raises(UnknownNameError, match="'gold'"):
        CookTorrance(ior="golld")
    with pytest.raises(UnknownNameError, match="shininess"):
        CookTorrance(shininess=3)


@pytest.mark.parametrize("ior", [None, 1.5, (0.37, 2.82), "gold", [1.4, 1.5, 1.6], {"n": 1.5, "k": 2}])
def test_metadata_is_json_that_makes_the_same_model(ior: Any) -> None:
    b = CookTorrance(roughness=[0.1, 0.2, 0.3], ior=ior, diffuse=0.1, specular=0.9)
    facts = json.loads(json.dumps(b.metadata))
    assert facts["model"] == "cook_torrance"
    again = CookTorrance(**facts["parameters"])
    np.testing.assert_array_equal(again.evaluate(0.3, 0.4, 3.0), b.evaluate(0.3, 0.4, 3.0))


def test_approximate_conductor_warns_for_glass_and_not_for_gold() -> None:
    with pytest.warns(UserWarning, match=r"0\.099 off"):
        CookTorrance(fresnel="conductor_approximate", ior="glass")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        CookTorrance(fresnel="conductor_approximate", ior="gold")


def test_models_import_numpy_only() -> None:
    code = (
        "import sys, brdfcore.models.cook_torrance as c, brdfcore.models.mirror, brdfcore.models.lambert\n"
        "c.CookTorrance(distribution='gaussian', ior='gold').albedo(0.3)\n"
        "print([m for m in ('scipy', 'numba', 'h5py', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# ---- properties ------------------------------------------------------------------------------------

THETA = st.one_of(st.floats(0, HALF_PI), st.sampled_from([0.0, 1e-12, 1e-8, HALF_PI]))
MODELS = st.builds(
    lambda lobe, m, ior: CookTorrance(distribution=lobe[0], masking=lobe[1], roughness=m, ior=ior),
    st.sampled_from([*LOBES, ("ggx", "none"), ("beckmann", "none")]),
    st.floats(1e-8, 1.5),
    st.sampled_from([None, 1.5, 1 + 1e-8, "gold", complex(1e-3, 100)]),
)


@given(MODELS, THETA, THETA, st.floats(-1e6, 1e6))
def test_reciprocal_bilateral_and_non_negative(model: CookTorrance, theta_i: float, theta_o: float, phi: float) -> None:
    value = model.evaluate(theta_i, theta_o, phi)
    assert np.isfinite(value).all()
    assert (value >= 0).all()
    assert value == model.evaluate(theta_o, theta_i, phi) == model.evaluate(theta_i, theta_o, -phi)


COMPONENT = st.floats(-1, 1)


@given(MODELS, st.tuples(COMPONENT, COMPONENT), st.floats(5e-324, 1), st.tuples(COMPONENT, COMPONENT), st.floats(0, 1))
def test_vectors_are_reciprocal_and_non_negative(
    model: CookTorrance, xy_i: tuple[float, float], z_i: float, xy_o: tuple[float, float], z_o: float
) -> None:
    wi, wo = [*xy_i, z_i], [*xy_o, z_o if any(xy_o) else 1.0]
    value = model.evaluate_vectors(wi, wo)
    assert np.isfinite(value).all()
    assert (value >= 0).all()
    assert value == model.evaluate_vectors(wo, wi)


def test_a_ggx_lobe_leaves_room_for_a_diffuse_part() -> None:
    """A dielectric reflects 4 % at the normal: what it leaves is the diffuse part's, with the angle where it ends."""
    b = bc.model("ggx", diffuse=0.4, ior=1.5)
    assert b.energy_conserving
    assert "energy" not in b.metadata
    past = bc.model("ggx", diffuse=0.9, ior=1.5)
    assert not past.energy_conserving
    angle = float(past.metadata["energy"].split("theta_i = ")[1].split()[0])
    below, above = past.albedo(np.radians([angle - 10, angle]))[:, 0]
    assert below <= 1 + 1e-5 < above
    for more in ({"diffuse": 0.99, "ior": 1.5}, {"diffuse": 0.2}, {"diffuse": 0.8, "specular": 8.0, "ior": 1.5}):
        with pytest.raises(bc.InputError, match="normal incidence"):
            bc.model("ggx", **more)
