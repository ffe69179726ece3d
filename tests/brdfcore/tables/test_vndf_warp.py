"""The visible-normal warp: exact on a known warp, equal to its twin, the same bits however it is called."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
import pytest

import brdfcore as bc
from brdfcore import testing
from brdfcore.base.channels import RGB, Channels
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.base.status import Status
from brdfcore.formats.rgl.tensor_file import encode
from brdfcore.kernels.tables import warp
from brdfcore.tables.base.table import BuildOptions
from brdfcore.tables.vndf_warp import VndfWarp, thinned
from tests.support.rgl_synthetic import Fields, fields_of, identity_fields, published_value
from tests.support.tiers import first_fast

REAL = Path(__file__).parents[3].parent / "shared" / "data" / "rgl" / "chm_light_blue_rgb.bsdf"
FLAGS = dict.fromkeys(("bilateral", "reciprocal", "energy_conserving", "non_negative"), False)
HALF_PI = np.pi / 2


def made(fields: Fields) -> VndfWarp:
    """The table of synthetic fields, without a file."""
    name = "spectra" if "wavelengths" in fields else "rgb"
    flat = fields["jacobian"][0] == 0
    return VndfWarp.from_densities(
        theta_i=fields["theta_i"],
        sigma=np.full(2, 0.25, np.float32) if flat else fields["sigma"][0],
        ndf=np.ones(2, np.float32) if flat else fields["ndf"][0],
        vndf=fields["vndf"][0],
        spectra=fields[name][0],
        channels=Channels(fields["wavelengths"].tolist(), "wavelength") if "wavelengths" in fields else RGB,
        flags=FLAGS,
    )


def spread(n: int, seed: int = 3, dtype: Any = np.float64) -> list[Any]:
    """Angles over the whole domain and, every third, near the mirror direction."""
    rng = np.random.default_rng(seed)
    theta_i, theta_o = rng.uniform(0, HALF_PI, (2, n))
    delta_phi = rng.uniform(-3 * np.pi, 3 * np.pi, n)
    near = slice(None, None, 3)
    theta_o[near] = np.clip(theta_i[near] + rng.normal(0, 0.01, theta_i[near].size), 0, HALF_PI)
    delta_phi[near] = np.pi + rng.normal(0, 0.02, theta_i[near].size)
    return [x.astype(dtype) for x in (theta_i, theta_o, delta_phi)]


# ---- a warp that is known -------------------------------------------------------------------------

MIRROR_OFFSETS = (0.0, 1e-15, 1e-12, 1e-8, 1e-4, 0.1)


def test_half_vector_keeps_its_digits_near_the_mirror_direction() -> None:
    """With an identity warp f_r cos(theta_o) is (u(theta_h), u(phi_h), 1): compared with 50 digits."""
    table = made(identity_fields())
    cases = [
        (a, b, c)
        for a in (0.0, 1e-8, 0.01, 0.7, 1.5, 1.5707)
        for off in MIRROR_OFFSETS
        for b in {min(a + off, HALF_PI), max(a - off, 0.0)}
        for c in {np.pi, np.pi + off, -np.pi + off, 3.0, off, 2.0 + 2 * np.pi, -3 * np.pi}
    ]
    with mp.workdps(50):
        for a, b, c in cases:
            x = mp.sin(a) + mp.sin(b) * mp.cos(c)
            y = mp.sin(b) * mp.sin(c)
            size = mp.hypot(x, y)
            u = mp.sqrt(2 / mp.pi * mp.atan2(size, mp.cos(a) + mp.cos(b)))
            v = (mp.atan2(y, x) + mp.pi) / (2 * mp.pi)
            found = table.evaluate(a, b, c) * np.cos(b)
            assert abs(found[0] - float(u)) <= 4e-15 + 1e-13 * float(u), (a, b, c)
            assert abs(found[2] - 1) <= 1e-14
            # phi_h has no digits where h = n to rounding; u(phi_h) = 0 and 1 are one direction
            if size > 1e-15:
                turn = abs(found[1] - float(v))
                assert min(turn, 1 - turn) <= 1e-13 + 1e-16 / float(size), (a, b, c)


def test_known_values_at_the_corners() -> None:
    table = made(identity_fields())
    for dtype in (np.float32, np.float64):
        half_pi = dtype(HALF_PI)
        normal = table.evaluate(dtype(0), dtype(0), dtype(1))
        assert normal[0] == 0
        assert abs(normal[2] - 1) <= 1e-6
        straight = table.evaluate(dtype(0.4), dtype(0), dtype(2))  # h half way, towards wi
        assert np.allclose(straight, [np.sqrt(2 / np.pi * 0.2), 0.5, 1 / np.cos(0)], atol=1e-6)
        retro = table.evaluate(dtype(0.6), dtype(0.6), dtype(0)) * np.cos(0.6)
        assert np.allclose(retro, [np.sqrt(2 / np.pi * 0.6), 0.5, 1], atol=1e-6)
        horizon = table.evaluate(dtype(0.5), half_pi, dtype(1))
        assert np.allclose(horizon[2], 1 / np.cos(HALF_PI), rtol=1e-6)
        assert np.isfinite(table.evaluate(half_pi, half_pi, np.array([0, 1, np.pi, -np.pi], dtype))).all()
        grazing = table.evaluate(half_pi, dtype(0.1), dtype(1))
        beside = table.evaluate(dtype(HALF_PI - 1e-6), dtype(0.1), dtype(1))
        assert np.allclose(grazing, beside, rtol=1e-4)


def test_f_cos_is_continuous_at_the_horizon_of_the_viewer() -> None:
    table = made(fields_of())
    near = HALF_PI - np.array([1e-3, 1e-6, 1e-9, 1e-12, 0.0])
    product = table.evaluate(0.7, near, 2.0) * np.cos(near)[:, None]
    assert np.allclose(product[1:], product[-1], rtol=1e-5)
    assert np.allclose(product[2:], product[-1], rtol=1e-8)


# ---- kernel, twin, definition ---------------------------------------------------------------------


@pytest.mark.parametrize("wavelengths", [0, 5])
@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float64, 1e-11), (np.float32, 2e-5)])
def test_kernels_equal_their_twin(wavelengths: int, dtype: Any, tolerance: float) -> None:
    table = made(fields_of(wavelengths=wavelengths, thetas=5, normals=(16, 12), samples=6))
    angles = spread(4_000, dtype=dtype)
    expected, found = (np.empty(4_000 * len(table.channels), dtype) for _ in range(2))
    assert warp.warp_numpy(*angles, *table._flat, expected, table._scales[np.dtype(dtype)]) == 0
    table._kernel(4_000, *angles, *table._flat, found, table._scales[np.dtype(dtype)])
    cos = np.repeat(np.cos(np.minimum(angles[1].astype(np.float64), HALF_PI)), len(table.channels))
    error = np.abs(found.astype(np.float64) - expected) * cos
    assert error.max() <= tolerance * np.abs(expected * cos).max()
    assert np.median(error / np.abs(expected * cos)) <= tolerance / 20


@pytest.mark.slow
@pytest.mark.parametrize("wavelengths", [0, 5])
def test_serial_and_parallel_give_the_same_bits(wavelengths: int) -> None:
    table = made(fields_of(wavelengths=wavelengths))
    for dtype in (np.float32, np.float64):
        angles = spread(10_007, dtype=dtype)
        a, b = (np.empty(10_007 * len(table.channels), dtype) for _ in range(2))
        assert table._kernel.serial(*angles, *table._flat, a, table._scales[np.dtype(dtype)]) == 0
        assert table._kernel.parallel(*angles, *table._flat, b, table._scales[np.dtype(dtype)]) == 0
        assert np.array_equal(a, b)


def test_any_number_of_channels_gives_what_three_give() -> None:
    three, four = fields_of(), fields_of(wavelengths=4)
    four["vndf"] = three["vndf"]
    four["spectra"][:, :, :3] = three["rgb"]
    angles = spread(500)
    assert np.allclose(made(four).evaluate(*angles)[:, :3], made(three).evaluate(*angles), rtol=1e-12)


def test_kernels_count_what_is_outside_and_read_nothing_beyond() -> None:
    table = made(fields_of())
    bad = np.array([np.nan, -1, 2, 1e300, -np.inf, 0.3])
    for dtype in (np.float32, np.float64):
        with np.errstate(over="ignore"):
            angles = [np.tile(bad.astype(dtype), 200) for _ in range(3)]
        out, twin = np.empty(3_600, dtype), np.empty(3_600, dtype)
        assert table._kernel.serial(*angles, *table._flat, out, table._scales[np.dtype(dtype)]) == 1_000
        assert warp.warp_numpy(*angles, *table._flat, twin, table._scales[np.dtype(dtype)]) == 1_000
        assert np.isfinite(out).all()
        assert np.allclose(out, twin, rtol=1e-5)


def test_theta_index_finds_every_slice() -> None:
    for nodes in ([0, 1.5], [0.2, 0.9, 1.0, 1.01], np.linspace(0, HALF_PI, 90), [0, 1e-3, 2e-3, 1.57]):
        nodes = np.asarray(nodes, np.float32)
        index = warp.theta_index(nodes)
        assert index is not None
        for theta in (np.linspace(0, HALF_PI, 5_001), nodes.astype(np.float64)):
            for dtype in (np.float32, np.float64):
                step = theta.astype(dtype) * dtype(index.size / HALF_PI)
                k = index[np.minimum(step, index.size - 1).astype(int)]
                k = np.minimum(k + (theta.astype(dtype) > nodes[k + 1]), nodes.size - 2)
                assert ((theta.astype(dtype) >= nodes[k]) | (k == 0)).all()
                assert ((theta.astype(dtype) <= nodes[k + 1]) | (k == nodes.size - 2)).all()
    assert warp.theta_index(np.array([0, 1e-6, 2e-6, 3e-6], np.float32)) is None


# ---- the table ------------------------------------------------------------------------------------


@pytest.mark.parametrize("wavelengths", first_fast(0, 5))
def test_conformance(wavelengths: int, tmp_path: Path) -> None:
    path = tmp_path / "made.bsdf"
    path.write_bytes(encode(fields_of(wavelengths=wavelengths, thetas=4, normals=(12, 10))))
    table = bc.read(path)
    assert isinstance(table, VndfWarp)
    testing.check_brdf(table)
    testing.check_table(table, tmp_path)
    testing.check_damage(path, tmp_path, reads=24)


@pytest.mark.shared
@pytest.mark.skipif(not REAL.exists(), reason="the real RGL files are not beside the project")
def test_conformance_of_the_sharpest_real_material(tmp_path: Path) -> None:
    table = bc.read(REAL)
    assert isinstance(table, VndfWarp)
    testing.check_brdf(table)
    testing.check_table(table, tmp_path)


@pytest.mark.shared
@pytest.mark.skipif(not REAL.exists(), reason="the real RGL files are not beside the project")
def test_storage_in_float32_costs_nothing_visible() -> None:
    """Against the definition in float64, on the sharpest material."""
    from brdfcore.formats.rgl.tensor_file import decode

    raw = {n: f.array for n, f in decode(REAL.read_bytes(), REAL.name).fields.items()}
    angles = spread(1_500)
    expected = published_value(raw, *angles) * np.cos(angles[1])[:, None]
    found = bc.read(REAL).evaluate(*angles) * np.cos(angles[1])[:, None]
    error = np.abs(found - expected)
    assert np.median(error / np.abs(expected)) <= 2e-7
    assert (error <= 1e-5 * (np.abs(expected) + np.abs(expected).mean())).all()


def test_delta_phi_is_periodic_and_reduced() -> None:
    table = made(fields_of())
    base = np.linspace(-3, 3, 13)
    values = table.evaluate(0.6, 0.9, base)
    for turns in (-1000, -2, -1, 1, 2, 1000):
        again = table.evaluate(0.6, 0.9, base + turns * 2 * np.pi)
        assert np.allclose(again, values, rtol=1e-9)


def test_inputs_need_not_be_writeable_or_aligned() -> None:
    table = made(fields_of())
    angles = spread(50)
    values = table.evaluate(*angles)
    frozen = [x.copy() for x in angles]
    for x in frozen:
        x.flags.writeable = False
    assert np.array_equal(table.evaluate(*frozen), values)
    shifted = [np.frombuffer(b"\0" + x.tobytes(), np.uint8)[1:].view(np.float64) for x in angles]
    assert np.array_equal(table.evaluate(*shifted), values)


def test_status_says_where_theta_i_was_measured() -> None:
    fields = fields_of(thetas=4)
    fields["theta_i"] = np.array([0.1, 0.5, 1.0, 1.2], np.float32)
    table = made(fields)
    theta = np.array([0.0, 0.05, 0.2, 1.1, 1.3, HALF_PI])
    codes = table.status(theta, 0.3, 0.4)
    inside = [Status.INTERPOLATED if 0.1 <= t <= 1.2 else Status.EXTRAPOLATED for t in theta]
    assert codes.tolist() == inside
    # beyond the ends the nearest slice is continued
    fields["jacobian"][0] = 0
    fields["rgb"][0] = np.arange(1, 5, dtype=np.float32).reshape(4, 1, 1, 1)
    product = made(fields).evaluate(theta, 0.3, 0.4)[:, 0] * np.cos(0.3)
    assert np.allclose(product, [1, 1, 1.25, 3.5, 4, 4], rtol=1e-6)
    full = made(fields_of())
    assert full.status(HALF_PI, 0.1, 0.1) == Status.INTERPOLATED
    fields["theta_i"][-1] = np.nextafter(np.float32(HALF_PI), np.float32(0)) - np.float32(1e-7)
    assert made(fields).status(np.float32(HALF_PI), 0.1, 0.1) == Status.INTERPOLATED


def test_where_no_normal_is_visible_the_value_is_finite() -> None:
    """theta_i = pi/2 with zero density behind wi, as in the real files: 0/0 has to be decided."""
    fields = fields_of(thetas=2, normals=(8, 6))
    fields["vndf"][0, 1, :2] = 0
    fields["vndf"][0, 1, -2:] = 0
    table = made(fields)
    for dtype in (np.float32, np.float64):
        angles = [dtype(HALF_PI), dtype(HALF_PI), np.linspace(-np.pi, np.pi, 101, dtype=dtype)]
        assert np.isfinite(table.evaluate(*angles)).all()


def test_build_keeps_its_own_kind() -> None:
    source = made(fields_of())
    source.source = {"name": "a", "format": "rgl", "sha256": "0"}
    copy = bc.tabulate(source, "vndf_warp")
    assert isinstance(copy, VndfWarp)
    assert copy.error["l1"] == 0
    assert copy.id == source.id
    assert copy.source == source.source
    assert VndfWarp.can_hold(source)
    assert not VndfWarp.can_hold(2 * source)  # "auto" leaves it alone: it would be fitted
    for options in (BuildOptions(shape=(2, 2, 2)), BuildOptions(fold=frozenset({"bilateral"}))):
        with pytest.raises(InputError):
            VndfWarp.build(source, options)
    fields = fields_of()
    fields["rgb"][0, 0, 0, 0, 0] = -1
    zeroed = VndfWarp.build(made(fields), BuildOptions(negatives="zero"))
    assert zeroed.non_negative
    assert zeroed.report["done"] == ["1 negative samples set to zero, as asked"]


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("spectra", lambda a: a[:, :, :, :2]),
        ("spectra", lambda a: a[:, :1]),
        ("spectra", lambda a: a * np.float32(np.nan)),
        ("theta_i", lambda a: a[::-1]),
        ("theta_i", lambda a: a[:2]),
        ("theta_index", lambda a: a + np.int32(1)),
        ("theta_index", lambda a: a.astype(np.int64)),
        ("sigma", lambda a: -a),
        ("sigma", lambda a: a[:1]),
        ("ndf", lambda a: -a),
        ("ndf", lambda a: a.astype(np.float64)),
        ("warp", lambda a: a[:, :, :, :1]),
        ("warp", lambda a: -a),
        ("rows", lambda a: a[:, :2]),
        ("rows", None),
    ],
)
def test_arrays_that_do_not_fit_are_refused(name: str, change: Any) -> None:
    table = made(fields_of())
    arrays = table.to_arrays()
    if change is None:
        del arrays[name]
    else:
        arrays[name] = change(arrays[name])
    with pytest.raises(FileFormatError) as caught:
        VndfWarp.from_arrays(arrays, {}, table.channels, table.flags)
    assert name in caught.value.detail


def test_importing_the_table_and_the_format_loads_no_compiler() -> None:
    code = "import sys, brdfcore.tables.vndf_warp, brdfcore.formats.rgl.format; sys.exit('numba' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_fewer_nodes_of_the_normals() -> None:
    """A density that is linear between every other node loses nothing by them; its samples are all kept."""
    fields = fields_of()
    n_y, n_x = fields["vndf"].shape[2:]
    source = made(fields)
    whole = source.to_arrays()
    kept = thinned(whole["warp"], whole["rows"], (n_y, n_x))
    assert kept["warp"] == pytest.approx(whole["warp"], rel=1e-6)
    assert kept["rows"] == pytest.approx(whole["rows"], rel=1e-6)
    # twice the nodes of a bilinear density, thinned again
    fine = np.zeros((*whole["warp"].shape[:1], 2 * n_y - 1, 2 * n_x - 1))
    density = fields["vndf"][0].astype(np.float64)
    fine[:, ::2, ::2] = density
    fine[:, ::2, 1::2] = 0.5 * (density[:, :, 1:] + density[:, :, :-1])
    fine[:, 1::2] = 0.5 * (fine[:, 2::2] + fine[:, :-2:2])
    doubled = made({**fields, "vndf": fine[None].astype(np.float32)})
    again = VndfWarp.build(doubled, BuildOptions(shape=(n_y, n_x)))
    assert again.to_arrays()["warp"] == pytest.approx(whole["warp"], rel=1e-5, abs=1e-7)
    assert again.to_arrays()["rows"] == pytest.approx(whole["rows"], rel=1e-5, abs=1e-7)
    assert np.array_equal(again.to_arrays()["spectra"], whole["spectra"])
    angles = spread(2_000)
    assert again.evaluate(*angles) == pytest.approx(doubled.evaluate(*angles), rel=1e-4, abs=1e-6)
    assert "density of visible normals" in again.report["done"][-1]
    with pytest.raises(InputError, match="visible normals"):
        VndfWarp.build(source, BuildOptions(shape=(n_y + 1, n_x)))


def test_candidates_are_smaller_than_the_source() -> None:
    source = made(fields_of())
    found = list(VndfWarp.candidates(source, BuildOptions(), None))
    sizes = [VndfWarp.build(source, o).nbytes for o in found]
    assert sizes == [o.nbytes for o in found] == sorted(sizes)
    assert sizes[-1] == source.nbytes
    assert found[-1].shape is None
    assert next(iter(VndfWarp.candidates(source, BuildOptions(), sizes[1]))).nbytes == sizes[1]
    assert list(VndfWarp.candidates(source, BuildOptions(fold=frozenset({"bilateral"})), None)) == []
