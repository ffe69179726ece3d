"""Half/difference tables: coordinates, kernels against their twin, accuracy on sharp lobes, folds, hostile arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mpmath import mp, mpf

import brdfcore as bc
from brdfcore import testing
from brdfcore.base.geometry import vectors_from_angles
from brdfcore.kernels.machine import launch
from brdfcore.kernels.tables import half_coordinates as coordinates
from brdfcore.kernels.tables import half_difference as kernels
from brdfcore.metrics import FLAG_DEFECT, reciprocity_defect
from brdfcore.tables.base.half_fit import shape_for
from brdfcore.tables.base.layout import angles_of
from brdfcore.tables.half_difference import HalfDifference
from tests import shared
from tests.benchmarks.accuracy import reference_l1
from tests.support.sources import Skewed
from tests.support.tiers import first_fast


def gold(roughness: float, distribution: str = "beckmann") -> bc.Brdf:
    return bc.model("cook_torrance", roughness=roughness, ior="gold", distribution=distribution)


def build(source: bc.Brdf, shape: tuple[int, int, int] = (24, 12, 12), **options: object) -> HalfDifference:
    table = bc.tabulate(source, "half_difference", shape=shape, **options)  # type: ignore[arg-type]
    assert isinstance(table, HalfDifference)
    return table


TABLES = {
    "reciprocal": gold(0.2),
    "three channels": bc.model("cook_torrance", diffuse=[0.3, 0.2, 0.1], specular=0.5, roughness=0.1, ior="glass"),
    "four channels": bc.model("lambert", reflectance=[0.1, 0.2, 0.3, 0.4]),
    "no symmetry": Skewed(),
    "around the mirror direction": bc.model("phong", exponent=2_000),
}


@pytest.fixture(scope="module")
def tables() -> dict[str, HalfDifference]:
    return {name: build(source) for name, source in TABLES.items()}


def test_coordinates_against_mpmath() -> None:
    """theta_h, theta_d and phi_d from 40-digit vectors: half vector, and d = R_y(-theta_h) R_z(-phi_h) wi."""
    cases = [(0.3, 0.3 + 1e-7, np.pi - 1e-6), (1.2, 0.4, 2.0), (0.7, 0.7, 3.0), (1.5, 1.45, -0.4), (1e-5, 0.9, 1.0)]
    angles = np.array(cases)
    u, w, z = coordinates.coordinates_numpy(*angles.T, False, False)
    with mp.workdps(40):
        for k, (ti, to, dp) in enumerate(cases):
            ti, to, dp = mpf(float(ti)), mpf(float(to)), mpf(float(dp))
            wi = mp.matrix([mp.sin(ti), 0, mp.cos(ti)])
            wo = mp.matrix([mp.sin(to) * mp.cos(dp), mp.sin(to) * mp.sin(dp), mp.cos(to)])
            h = wi + wo
            h = h / mp.norm(h)
            theta_h, phi_h = mp.acos(h[2]), mp.atan2(h[1], h[0])
            flat = [wi[0] * mp.cos(phi_h) + wi[1] * mp.sin(phi_h), wi[1] * mp.cos(phi_h) - wi[0] * mp.sin(phi_h), wi[2]]
            d_x = flat[0] * mp.cos(theta_h) - flat[2] * mp.sin(theta_h)
            d_z = flat[0] * mp.sin(theta_h) + flat[2] * mp.cos(theta_h)
            theta_d, phi_d = mp.acos(d_z), mp.atan2(flat[1], d_x)
            t = mp.tan(theta_h)
            assert u[k] == pytest.approx(float(t * t), rel=1e-13)
            assert w[k] == pytest.approx(float(mp.cos(theta_d) ** 2), rel=1e-13)
            c, s = abs(mp.cos(phi_d)), abs(mp.sin(phi_d))
            diamond = s / (s + c) if mp.cos(phi_d) >= 0 else 2 - s / (s + c)
            assert abs(z[k]) == pytest.approx(float(diamond), rel=1e-9)


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("bilateral", [True, False])
def test_coordinates_are_inverted(bilateral: bool, mirror: bool) -> None:
    rng = np.random.default_rng(0)
    theta_i, theta_o = rng.uniform(0, 1.55, (2, 2_000))
    delta_phi = rng.uniform(0 if bilateral else -np.pi, np.pi, 2_000)
    at = coordinates.coordinates_numpy(theta_i, theta_o, delta_phi, bilateral, False, mirror)
    found = angles_of(*at, mirror)
    for a, b in zip(found, (theta_i, theta_o, delta_phi), strict=True):
        assert np.abs(a - b).max() < 1e-10


def test_the_mirror_coordinate_against_mpmath() -> None:
    """u = sin^2 of half the angle between viewer and mirror direction, from 40-digit vectors."""
    angles = np.array([(0.3, 0.3 + 1e-7, np.pi - 1e-6), (1.2, 0.4, 2.0), (0.7, 0.7, 3.0), (1e-5, 0.9, 1.0)])
    u = coordinates.coordinates_numpy(*angles.T, False, False, True)[0]
    with mp.workdps(40):
        for k, (ti, to, dp) in enumerate(angles):
            ti, to, dp = mpf(float(ti)), mpf(float(to)), mpf(float(dp))
            reflected = mp.matrix([-mp.sin(ti), 0, mp.cos(ti)])
            wo = mp.matrix([mp.sin(to) * mp.cos(dp), mp.sin(to) * mp.sin(dp), mp.cos(to)])
            assert u[k] == pytest.approx(float((1 - (reflected.T * wo)[0]) / 2), rel=1e-12)


@pytest.mark.parametrize("parallel", first_fast(False, True), ids=["serial", "parallel"])
@pytest.mark.parametrize("name", TABLES)
def test_kernels_against_their_twin(name: str, parallel: bool, tables: dict[str, HalfDifference]) -> None:
    """Serial and parallel to the bit; the twin, library functions in float64, to rounding."""
    table = tables[name]
    rng = np.random.default_rng(1)
    n, channels = 2 * launch.PARALLEL_FROM, len(table.channels)
    angles = [rng.uniform(low, top, n) for low, top in ((-0.05, 1.6), (-0.05, 1.6), (-9.5, 9.5))]
    angles[0][:2] = np.nan, np.inf
    n_d, n_p = (np.int32(k) for k in table.arrays["values"].shape[1:3])
    for dtype, tolerance in ((np.float64, 2e-6), (np.float32, 1e-3)):
        given = [x.astype(dtype) for x in angles]
        inside = (given[0] >= 0) & (given[0] <= 1.57) & (given[1] >= 0) & (given[1] <= 1.57)
        found, counts = [], []
        kernel = table._kernels[0]
        for run in (kernel.serial, kernels.half_numpy, *([kernel.parallel] if parallel else [])):
            out = np.zeros(n * channels, dtype)
            scale, folds = table._scales[np.dtype(dtype)], (table.bilateral, table._reciprocal_fold)
            counts.append(run(*given, *table._flat, out, scale, *folds, n_d, n_p))
            found.append(out.reshape(n, channels)[inside])
        assert counts[0] > 0
        assert counts == [counts[0]] * len(counts)
        assert np.array_equal(found[0], found[-1]) or not parallel
        off = np.abs(found[0] - found[1]) / (np.abs(found[1]) + np.abs(found[1]).mean())
        assert off.max() < tolerance


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("name", TABLES)
def test_from_vectors(name: str, dtype: type, tables: dict[str, HalfDifference]) -> None:
    """The same values as from angles, whatever the vectors' lengths; exactly 0 below the horizon; scalar = batch."""
    table = tables[name]
    rng = np.random.default_rng(2)
    theta_i, theta_o = rng.uniform(0, 1.5, (2, 2_000))
    delta_phi = rng.uniform(-np.pi, np.pi, 2_000)
    expected = table.evaluate(theta_i, theta_o, delta_phi)
    unit = [v.astype(dtype) for v in vectors_from_angles(theta_i, theta_o, delta_phi)]
    tolerance = 1e-10 if dtype is np.float64 else 2e-4  # float32 vectors are other directions, by 6e-8
    for longer in (1, 37, 2.0**60):  # the last: lengths whose square float32 does not hold
        wi, wo = (np.ascontiguousarray(v * dtype(longer)) for v in unit)
        wo[::7, 2] *= -1
        found = table.evaluate_vectors(wi, wo)
        assert found.dtype == dtype
        assert (found[::7] == 0).all()
        kept = np.arange(2_000) % 7 != 0
        scale = np.abs(expected[kept]).mean()
        assert np.abs(found - expected)[kept].max() < tolerance * scale * 50
        assert np.median(np.abs(found - expected)[kept] / scale) < tolerance
        one = np.stack([table.evaluate_vectors(a, b) for a, b in zip(wi[:50], wo[:50])])
        assert np.array_equal(one, found[:50])
        out = np.empty_like(found)
        assert table.evaluate_vectors(wi, wo, out=out) is out
        assert np.array_equal(out, found)


@pytest.mark.slow
def test_vectors_kernels_agree(tables: dict[str, HalfDifference]) -> None:
    """Serial and parallel to the bit, unusable vectors counted."""
    for table in tables.values():
        n = 2 * launch.PARALLEL_FROM
        wi, wo = np.random.default_rng(3).normal(size=(2, n, 3)).astype(np.float32)
        wi[5], wo[7, 1] = 0, np.nan
        found, counts = [], []
        for run in (table._kernels[1].serial, table._kernels[1].parallel):
            out = np.zeros(n * len(table.channels), np.float32)
            scale, folds = table._scales[np.dtype(np.float32)], (table.bilateral, table._reciprocal_fold)
            counts.append(run(wi.reshape(-1), wo.reshape(-1), *table._flat, out, scale, *folds, table._n_d, table._n_p))
            found.append(out)
        assert counts == [2, 2]
        assert np.array_equal(found[0], found[1])


@pytest.mark.parametrize("bad", [[0.0, 0.0, 0.0], [np.nan, 0.0, 1.0], [0.0, np.inf, 1.0]])
def test_vectors_that_are_no_direction(bad: list[float], tables: dict[str, HalfDifference]) -> None:
    wi = np.array([[0.0, 0.0, 1.0], bad])
    with pytest.raises(bc.InputError, match=r"wi\[1\]"):
        tables["reciprocal"].evaluate_vectors(wi, [0.0, 0.0, 1.0])


def test_reciprocal_to_the_bit_from_vectors(tables: dict[str, HalfDifference]) -> None:
    wi, wo = np.abs(np.random.default_rng(4).normal(size=(2, 500, 3)))
    table = tables["reciprocal"]
    assert np.array_equal(table.evaluate_vectors(wi, wo), table.evaluate_vectors(wo, wi))


@pytest.mark.parametrize("name", TABLES)
def test_conforms(name: str, tables: dict[str, HalfDifference], tmp_path: Path) -> None:
    testing.check_brdf(tables[name])
    testing.check_table(tables[name], tmp_path)


@pytest.mark.parametrize("distribution", first_fast("ggx", "beckmann"))
@pytest.mark.parametrize("roughness", first_fast(0.1, 1.0, 0.01, 0.003))
def test_a_lobe_of_any_width(roughness: float, distribution: str) -> None:
    """Within 128 kB: L1 below .002, where the plain grid of 5.8 MB is off by .0004 to 3."""
    table = build(gold(roughness, distribution), (63, 31, 31))
    assert table.nbytes <= 128_000
    assert table.error["l1"] < 0.002
    assert table.error["negatives"] == 0


@pytest.mark.slow
def test_a_spike_on_a_broad_lobe() -> None:
    """A lobe of one degree on one of thirty: spacing follows the error."""
    spike = 0.02 * gold(0.015) + 0.9 * gold(0.5)
    table = build(spike, (79, 39, 39))  # 240 kB
    assert table.error["l1"] < 0.004


@pytest.mark.slow
def test_a_lobe_around_the_mirror_direction() -> None:
    """Phong's, which has another width at each theta_d in half/difference coordinates: off by .017 in 1 MB there."""
    table = build(bc.model("phong", exponent=2_000), (63, 31, 31))
    assert table.mirror
    assert table.error["l1"] < 0.002
    assert not build(gold(0.2)).mirror


@pytest.mark.slow
def test_fast_and_slow_growth_towards_the_horizon() -> None:
    assert build(gold(0.3)).factor == "sum"
    assert bc.tabulate(bc.model("lambert"), "half_difference", shape=(8, 8, 8)).error["l1"] < 2e-3


@pytest.mark.slow
def test_folds() -> None:
    """Asked for, a fold makes the table symmetric, and the error says what that costs."""
    plain = build(Skewed(), (32, 16, 16))
    folded = build(Skewed(), (32, 16, 16), fold=("bilateral", "reciprocal"))
    assert plain.flags["bilateral"] is plain.flags["reciprocal"] is False
    assert folded.bilateral
    assert folded.reciprocal
    assert reciprocity_defect(folded) <= FLAG_DEFECT
    assert plain.error["l1"] < 0.02 < folded.error["l1"]
    assert folded.arrays["map_p"].size < plain.arrays["map_p"].size


def test_negative_values(tables: dict[str, HalfDifference]) -> None:
    kept, zeroed = tables["no symmetry"], build(Skewed(), negatives="zero")
    assert not kept.non_negative
    assert zeroed.non_negative
    assert any("negative" in sentence for sentence in zeroed.report["done"])
    assert tables["reciprocal"].non_negative


def test_a_delta_stays_apart() -> None:
    table = build(0.5 * bc.model("mirror", ior="silver") + bc.model("lambert", reflectance=0.2))
    assert table.has_delta
    assert table.albedo(0.3)[0] == pytest.approx(0.2 + table.delta_reflectance(0.3)[0], abs=2e-3)


@pytest.mark.parametrize("symmetric", [True, False])
@pytest.mark.parametrize("nodes", [500, 10_000, 300_000])
def test_shapes_fit(nodes: int, symmetric: bool) -> None:
    for shape in shape_for(nodes, symmetric, symmetric):
        assert np.prod(shape) <= nodes
        assert np.prod(shape) > 0.6 * nodes


def broken(table: HalfDifference, name: str, change: object) -> dict[str, object]:
    arrays = {k: v.copy() for k, v in table.to_arrays().items()}
    arrays[name] = change(arrays[name])  # type: ignore[operator]
    return {"arrays": arrays, "attributes": table.attributes()}


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("values", lambda a: a.astype(np.float32)),
        ("values", lambda a: a[..., :0]),
        ("values", lambda a: a[:2]),
        ("values", lambda a: np.full_like(a, np.nan)),
        ("guide_h", lambda a: a[:-1]),
        ("guide_h", lambda a: a.astype(np.float32)),
        ("guide_d", lambda a: a.reshape(1, -1)),
        ("map_h", lambda a: a[:-1]),
        ("map_d", lambda a: a[:5]),
        ("map_d", lambda a: a.astype(np.int16)),
        ("map_p", lambda a: np.append(a, a[-1])),
    ],
)
def test_arrays_that_would_lead_a_look_up_astray(name: str, change: object, tables: dict[str, HalfDifference]) -> None:
    table = tables["reciprocal"]
    with pytest.raises(bc.FileFormatError, match=name):
        HalfDifference.from_arrays(**broken(table, name, change), channels=table.channels, flags=table.flags)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "attributes",
    [
        {},
        {"scale": 0, "factor": "sum", "mirror": False, "guide_low": 0.0, "guide_step": 1e-4},
        {"scale": 1.0, "factor": "x", "mirror": False, "guide_low": 0.0, "guide_step": 1e-4},
        {"scale": 1.0, "factor": "sum", "mirror": False, "guide_low": -500.0, "guide_step": 1e-4},
        {"scale": 1.0, "factor": "sum", "mirror": False, "guide_low": 0.0, "guide_step": float("nan")},
        {"scale": 1.0, "factor": "sum", "mirror": False, "guide_low": 0.0},
        {"scale": 1.0, "factor": "sum", "mirror": 2, "guide_low": 0.0, "guide_step": 1e-4},
    ],
)
def test_bad_attributes(attributes: dict[str, object], tables: dict[str, HalfDifference]) -> None:
    table = tables["reciprocal"]
    with pytest.raises(bc.FileFormatError):
        HalfDifference.from_arrays(table.to_arrays(), attributes, table.channels, table.flags)


@shared.needs_shared
@pytest.mark.parametrize("name", ["chm_light_blue", "cg_sunflower", "paper_white"])
@pytest.mark.slow
def test_measured_materials(name: str) -> None:
    """768 kB, three channels: the worse half's reference L1 stays below .03 (first tries: .128, .084, .002)."""
    source = bc.read(shared.rgl_path(name))
    table = bc.tabulate(source, "half_difference", max_bytes=768_000)
    assert table.nbytes <= 768_000
    theta_i, theta_o, delta_phi, reference = shared.rgl_reference(name)
    found = table.evaluate(theta_i, theta_o, delta_phi)
    for half in (slice(0, 2000), slice(2000, None)):
        assert reference_l1(theta_i, theta_o, reference, found, half) < 0.03


@shared.needs_shared
def test_real_data_is_not_reciprocal_and_stays_so() -> None:
    source = bc.read(shared.rgl_path("chm_light_blue"))
    table = bc.tabulate(source, "half_difference", max_bytes=300_000)
    assert not table.reciprocal
    assert reciprocity_defect(table) == pytest.approx(reciprocity_defect(source), rel=0.1)


@pytest.mark.parametrize("roughness", first_fast(0.1, 0.3, 0.01))
def test_energy_at_the_horizon(roughness: float) -> None:
    """Albedo within 3 % at 89.9 degrees, where a table without the guide along theta_d is off by 14 %."""
    source = gold(roughness, "ggx")
    table = bc.tabulate(source, "half_difference", max_bytes=256_000)
    angle = np.radians(89.9)
    assert table.albedo_error(angle)[0] == pytest.approx(source.albedo(angle), rel=0.03)


def test_pairs_of_words() -> None:
    """Every 16-bit number, as the kernel loads and converts it, in both types."""
    import numba

    from brdfcore.kernels.machine.vectorised import load_words

    @numba.njit
    def decode(words, like):  # type: ignore[no-untyped-def]
        out = np.empty((words.size - 1, 2), np.float64)
        for k in range(words.size - 1):
            out[k] = load_words(words, np.int32(k), like)
        return out

    words = np.random.default_rng(0).permutation(65_536).astype(np.uint16)
    for like in (np.float32(1), np.float64(1)):
        found = decode(words, like)
        assert np.array_equal(found[:, 0], words[:-1])
        assert np.array_equal(found[:, 1], words[1:])


def test_half_precision_words() -> None:
    """Every finite float16, decoded by the kernel's bit moves."""
    import numba

    from brdfcore.kernels.machine.vectorised import load_halves

    @numba.njit
    def decode(words, like):  # type: ignore[no-untyped-def]
        out = np.empty(words.size - 1, np.float64)
        for k in range(words.size - 1):
            first, second = load_halves(words, np.int32(k), like)
            out[k] = first
            last = second
        return out, last

    words = np.arange(-32768, 32768).astype(np.int16)
    halves = words.view(np.float16)
    keep = np.isfinite(halves)
    words, halves = words[keep].copy(), halves[keep]
    decoded, last = decode(words, np.float64(1))
    assert np.array_equal(np.append(decoded, last) * 2.0**112, halves.astype(np.float64))
