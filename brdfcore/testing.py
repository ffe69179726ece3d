"""Conformance suites: what every registry entry is held to, shipped so that plug-ins can hold themselves to it.

Each `check_*` raises `AssertionError` with the numbers that disagree. They need nothing but numpy and the entry:

    from brdfcore.testing import check_brdf
    check_brdf(brdfcore.model("my_model"))
"""

from __future__ import annotations

import contextlib
import json
import pickle
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from brdfcore.base import catalogue
from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import FloatArray
from brdfcore.base.directions import mixture
from brdfcore.base.errors import BrdfError, FileFormatError, InputError
from brdfcore.base.geometry import Float64Array, vectors_from_angles
from brdfcore.base.status import Status
from brdfcore.formats.io.files import read
from brdfcore.metrics import ALBEDO_SLACK, FLAG_DEFECT, bilateral_defect, reciprocity_defect
from brdfcore.sampling.chi_square import chi_square
from brdfcore.tables.base.table import Table
from brdfcore.tables.store import open_table

HALF_PI = np.pi / 2


def sample_angles(n: int = 512, seed: int = 7) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Seeded pairs near and far from the mirror direction, then the corners: normal, horizon, mirror, retro."""
    drawn = mixture(n, seed)
    corners = np.array(
        [
            (0, 0, 0),
            (0, 0, np.pi),
            (0, HALF_PI, 1.0),
            (HALF_PI, 0, 1.0),
            (HALF_PI, HALF_PI, np.pi),
            (HALF_PI, HALF_PI, 0),
            (np.pi / 4, np.pi / 4, np.pi),
            (np.pi / 4, np.pi / 4, -np.pi),
            (np.pi / 4, np.pi / 4, 0),
            (1e-12, 1e-8, 2.0),
            (1.55, 1.56, 3.14159),
            (0.3, 0.4, 5 * np.pi),
            (0.3, 0.4, -1e6),
        ]
    )
    stacked = np.concatenate([np.stack([drawn.theta_i, drawn.theta_o, drawn.delta_phi], axis=1), corners])
    return stacked[:, 0].copy(), stacked[:, 1].copy(), stacked[:, 2].copy()


def check_brdf(b: Brdf, *, steps: bool = False) -> None:
    """Every suite that applies to any BRDF.

    `steps`: f is a step function (a nearest look-up), so that angles that differ by rounding may answer with another
    step: `check_float32` and `check_vectors` then ask for that of few directions only.
    """
    check_signature(b)
    check_scalar_equals_batch(b)
    check_float32(b, differing=0.05 if steps else 0.01)
    check_domain(b)
    check_vectors(b, differing=0.05 if steps else 0.0)
    check_uncertainty(b)
    check_claims(b)


def check_signature(b: Brdf) -> None:
    """Shapes, channels, dtypes, `out`, broadcasting, untouched inputs, JSON-ready description."""
    count = len(b.channels)
    assert isinstance(b.channels, Channels), b.channels
    theta_i, theta_o, delta_phi = sample_angles(64)
    kept = [x.copy() for x in (theta_i, theta_o, delta_phi)]
    values = b.evaluate(theta_i, theta_o, delta_phi)
    assert values.shape == (theta_i.size, count), values.shape
    assert values.dtype == np.float64, values.dtype
    for before, after in zip(kept, (theta_i, theta_o, delta_phi), strict=True):
        assert np.array_equal(before, after), "evaluate changed its input"
    assert np.isfinite(values).all(), f"not finite at {np.argwhere(~np.isfinite(values))[:3].tolist()}"
    out = np.full_like(values, 7.0)
    assert b.evaluate(theta_i, theta_o, delta_phi, out=out) is out, "evaluate must return `out`"
    assert np.array_equal(out, values), "`out` got other values"
    strided = np.empty((theta_i.size, 2 * count))[:, ::2]
    assert np.array_equal(b.evaluate(theta_i, theta_o, delta_phi, out=strided), values), "strided `out` differs"
    grid = b.evaluate(theta_i[:3, None], theta_o[None, :4], 1.0)
    assert grid.shape == (3, 4, count), grid.shape
    assert b.evaluate(0.1, 0.2, 0.3).shape == (count,)
    assert b.evaluate(np.zeros((0, 2)), 0.2, 0.3).shape == (0, 2, count)
    for bad in (np.empty((1, count)), np.empty((theta_i.size, count), np.float32)):
        _refused(lambda bad=bad: b.evaluate(theta_i, theta_o, delta_phi, out=bad), "out")
    json.dumps(b.describe(), allow_nan=False)


def check_scalar_equals_batch(b: Brdf) -> None:
    """One at a time, broadcast, reversed, strided and in one large batch: the same bits."""
    theta_i, theta_o, delta_phi = sample_angles(48)
    values = b.evaluate(theta_i, theta_o, delta_phi)
    for k in range(theta_i.size):
        one = b.evaluate(float(theta_i[k]), float(theta_o[k]), float(delta_phi[k]))
        assert _same(one, values[k]), f"scalar differs from batch at {k}: {one} and {values[k]}"
    back = b.evaluate(theta_i[::-1], theta_o[::-1], delta_phi[::-1])
    assert _same(back[::-1], values), "reversed input gives other bits"
    shared = np.zeros(values.size)
    shared[: theta_i.size] = theta_i
    found = b.evaluate(shared[: theta_i.size], theta_o, delta_phi, out=shared.reshape(values.shape))
    assert _same(found, values), "an `out` that shares memory with an input gives other values"
    frozen = theta_i.copy()
    frozen.flags.writeable = False
    assert _same(b.evaluate(frozen, theta_o, delta_phi), values), "read-only input differs"
    large = b.evaluate(*(np.tile(x, 200) for x in (theta_i, theta_o, delta_phi)))
    assert _same(large.reshape(200, *values.shape), np.broadcast_to(values, (200, *values.shape))), "batch size matters"
    i32, o32, d32 = (x.astype(np.float32) for x in (theta_i, theta_o, delta_phi))
    batch = b.evaluate(i32, o32, d32)
    for k in range(theta_i.size):
        assert _same(b.evaluate(i32[k], o32[k], d32[k]), batch[k]), f"float32 scalar differs from batch at {k}"


def check_float32(b: Brdf, *, relative: float = 2e-3, differing: float = 0.01) -> None:
    """float32 in, float32 out, close to float64 on the same numbers; float32's pi/2 is inside the domain.

    `relative` bounds |f32 - f64| against the median magnitude plus the value itself: a look-up in float32 has
    angle errors of 1e-7, which a sharp lobe turns into relative errors of 1e-7 / width. A part `differing` of the
    values may be off by more.
    """
    theta_i, theta_o = (x.astype(np.float32) for x in sample_angles(256)[:2])
    delta_phi = np.clip(sample_angles(256)[2], -np.pi, np.pi).astype(np.float32)
    single = b.evaluate(theta_i, theta_o, delta_phi)
    assert single.dtype == np.float32, single.dtype
    # float32's pi/2 means pi/2, which its exact value in float64 does not
    i64, o64 = (np.minimum(x.astype(np.float64), HALF_PI) for x in (theta_i, theta_o))
    double = b.evaluate(i64, o64, delta_phi.astype(np.float64))
    scale = np.abs(double) + np.median(np.abs(double))
    off = np.abs(single - double) > relative * scale
    assert off.mean() <= differing, f"{off.mean():.3g} of the float32 values are off by more than {relative}"
    assert np.isfinite(b.evaluate(np.float32(HALF_PI), np.float32(0.1), np.float32(np.pi))).all()
    assert b.evaluate(np.float32(0.1), 0.1, np.float32(0.1)).dtype == np.float64, "mixed input is float64"


def check_domain(b: Brdf) -> None:
    """NaN, infinite and past-the-horizon angles are errors naming argument and index, or what `outside` asks for."""
    good = np.full(5, 0.4)
    for position, name in enumerate(("theta_i", "theta_o", "delta_phi")):
        for bad in (
            np.nan,
            np.inf,
            -np.inf,
            *((-1e-9, np.nextafter(HALF_PI, 2.0), 1.5708, 4.0) if position < 2 else ()),
        ):
            angles = [good.copy(), good.copy(), good.copy()]
            angles[position][3] = bad
            error = _refused(lambda angles=angles: b.evaluate(*angles), name)
            assert error.context["index"] == [3], error.context
            marked = b.evaluate(*angles, outside="nan")
            assert np.isnan(marked[3]).all(), marked
            assert np.isfinite(np.delete(marked, 3, axis=0)).all(), marked
            assert b.status(*angles)[3] == Status.OUTSIDE
            if np.isnan(bad) or position == 2:
                _refused(lambda angles=angles: b.evaluate(*angles, outside="clip"), name)
            else:
                assert np.isfinite(b.evaluate(*angles, outside="clip")).all()
    for wrong in ("text", 1j, [[1, 2], [3]], None, object()):
        _refused(lambda wrong=wrong: b.evaluate(wrong, 0.1, 0.1), "theta_i")
    _refused(lambda: b.evaluate(np.zeros(3), np.zeros(4), 0.0), "theta_i, theta_o, delta_phi")
    turned = b.evaluate(0.5, 0.6, np.array([0.7, 0.7 + 2 * np.pi, 0.7 - 2 * np.pi, 0.7 + 200 * np.pi]))
    assert np.allclose(turned, turned[0], rtol=1e-6, atol=1e-9), "delta_phi is not periodic"


def check_uncertainty(b: Brdf) -> None:
    """Half-widths of the shape and dtype of the values, finite, not negative, the same bits alone and in a batch;
    angles outside are what they are to `evaluate`."""
    angles = sample_angles(48)
    for dtype in (np.float64, np.float32):
        given = [x.astype(dtype) for x in angles]
        widths = b.uncertainty(*given)
        assert widths.shape == b.evaluate(*given).shape, widths.shape
        assert widths.dtype == dtype, widths.dtype
        assert np.isfinite(widths).all(), f"not finite at {np.argwhere(~np.isfinite(widths))[:3].tolist()}"
        assert (widths >= 0).all(), f"negative at {np.argwhere(widths < 0)[:3].tolist()}"
        for k in (0, 17, 48):
            assert _same(b.uncertainty(*(x[k] for x in given)), widths[k]), f"alone it differs at {k}"
    grid = b.uncertainty(angles[0][:3, None], angles[1][None, :4], 1.0)
    assert grid.shape == (3, 4, len(b.channels)), grid.shape
    bad = angles[0].copy()
    bad[3] = 2.0
    _refused(lambda: b.uncertainty(bad, *angles[1:]), "theta_i")
    marked = b.uncertainty(bad, *angles[1:], outside="nan")
    assert np.isnan(marked[3]).all(), marked[3]
    assert np.isfinite(np.delete(marked, 3, axis=0)).all()


def check_sampling(b: Brdf, *, n: int = 20_000, seed: int = 11) -> None:
    """Directions drawn: shapes and types, unit and above the horizon, weight = f cos/pdf with `pdf` of the same
    directions, their mean the albedo; a chi-square test of directions against the density; errors that name the input.
    """
    rng = np.random.default_rng(seed)
    count = len(b.channels)
    for theta in np.radians([1.0, 30.0, 70.0]):
        wi = 2 * np.array([np.sin(theta) * 0.6, -np.sin(theta) * 0.8, np.cos(theta)])
        u = rng.random((n, 2))
        wo, weight, pdf = drawn = b.sample(wi, u)
        assert (wo.shape, weight.shape, pdf.shape) == ((n, 3), (n, count), (n,)), (wo.shape, weight.shape, pdf.shape)
        assert np.allclose((wo * wo).sum(axis=1), 1, atol=1e-9)
        assert np.isfinite(weight).all(), weight
        regular = ~drawn.delta & (wo[:, 2] > 0)
        assert (pdf > 0).all(), pdf.min()
        assert drawn.delta.any() == (b.has_delta and bool((b.delta_reflectance(theta) > 0).any()))
        if drawn.delta.any():
            mirror = wi / 2 * [-1, -1, 1]
            assert np.allclose(wo[drawn.delta], mirror, atol=1e-12), "the mirror part goes elsewhere"
        albedo, error = b.albedo_error(theta)
        spread = 6 * weight.std(axis=0) / np.sqrt(n) + 5 * error + 2e-3 * np.abs(albedo).max(initial=0)
        assert (np.abs(weight.mean(axis=0) - albedo) <= spread).all(), (weight.mean(axis=0), albedo, spread)
        if not regular.any():
            continue
        again = b.pdf(wi, wo[regular])
        off = np.abs(again - pdf[regular]) > 1e-6 * pdf[regular]
        assert off.mean() < 0.002, f"pdf differs from that of the draw in {off.mean():.3g}"
        f = b.evaluate_vectors(wi, wo[regular])
        expected = f * (wo[regular, 2] / pdf[regular])[:, None]
        assert np.allclose(weight[regular], expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max(initial=0))
        statistic, freedom = chi_square(b, wi, len(u), np.asarray(wo[regular], np.float64))
        limit = freedom + 3.8 * np.sqrt(2 * freedom) + 10  # one in 10,000, by the normal approximation and its skew
        assert statistic < limit, f"chi-square {statistic:.1f} with {freedom} degrees of freedom"
    single = b.sample(wi.astype(np.float32), np.array([0.3, 0.4], np.float32))
    assert {x.dtype for x in single} == {np.dtype(np.float32)}
    assert single.pdf.shape == ()
    down = b.sample([0, 0.6, -0.8], [0.5, 0.5])
    assert (down.weight == 0).all()
    assert down.pdf == 0
    assert b.pdf([0, 0.6, -0.8], [0, 0, 1]) == b.pdf([0, 0, 1], [0, 0.6, -0.8]) == 0
    for bad in ([1.0, 0.5], [-0.1, 0.5], [np.nan, 0.5], [0.5, 1.0], [0.1, 0.2, 0.3]):
        _refused(lambda bad=bad: b.sample([0, 0, 1], bad), "u")
    for bad in ([0.0, 0.0, 0.0], [np.nan, 0.0, 1.0], [0.0, 1.0]):
        _refused(lambda bad=bad: b.sample(bad, [0.1, 0.2]), "wi")


def check_vectors(b: Brdf, *, differing: float = 0.0) -> None:
    """From vectors as from angles, but for a part `differing`; exactly 0 at and below the horizon; any length; zero
    and NaN refused."""
    theta_i, theta_o, delta_phi = sample_angles(128)
    # at the pole vectors have no azimuth; close to the horizon the cosine of a rounded vector is off
    keep = (theta_i > 0) & (theta_o > 0) & (theta_i < 1.5) & (theta_o < 1.5) & (np.abs(delta_phi) < 4)
    theta_i, theta_o, delta_phi = theta_i[keep], theta_o[keep], delta_phi[keep]
    wi, wo = vectors_from_angles(theta_i, theta_o, delta_phi)
    by_angle, by_vector = b.evaluate(theta_i, theta_o, delta_phi), b.evaluate_vectors(3.0 * wi, 0.1 * wo)
    scale = np.abs(by_angle) + np.median(np.abs(by_angle))
    # the two entry points see directions that differ by rounding; a lobe of width m turns that into 1e-15/m
    off = np.abs(by_angle - by_vector) > 1e-6 * scale
    assert off.mean() <= differing, float((np.abs(by_angle - by_vector) / scale).max())
    down = np.array([[0.0, 0.6, -0.8], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    values = b.evaluate_vectors(down, np.array([0.0, 0.0, 1.0]))
    assert (values[:2] == 0).all(), values
    for bad in ([0.0, 0.0, 0.0], [np.nan, 0.0, 1.0], [np.inf, 0.0, 1.0]):
        _refused(lambda bad=bad: b.evaluate_vectors(bad, [0.0, 0.0, 1.0]), "wi")
    _refused(lambda: b.evaluate_vectors([0.0, 1.0], [0.0, 0.0, 1.0]), "wi")


def check_claims(b: Brdf) -> None:
    """Reciprocity, bilateral symmetry, positivity, energy and the delta part, each only as far as claimed."""
    if b.bilateral:
        assert bilateral_defect(b) <= FLAG_DEFECT, f"claims bilateral, defect {bilateral_defect(b):.3g}"
    if b.reciprocal:
        assert reciprocity_defect(b) <= FLAG_DEFECT, f"claims reciprocal, defect {reciprocity_defect(b):.3g}"
    theta_i, theta_o, delta_phi = sample_angles(2_048, seed=11)
    if b.non_negative:
        smallest = b.evaluate(theta_i, theta_o, delta_phi).min()
        assert smallest >= 0, f"claims non-negative, found {smallest}"
    theta = np.radians([0.0, 20.0, 45.0, 70.0, 85.0, 89.0])
    albedo = b.albedo(theta)
    delta = b.delta_reflectance(theta)
    assert albedo.shape == delta.shape == (theta.size, len(b.channels))
    if b.energy_conserving:
        assert (albedo <= 1 + ALBEDO_SLACK).all(), f"claims energy conservation, albedo {albedo.max()}"
    assert b.has_delta or not delta.any(), "a delta reflectance without has_delta"
    assert (delta >= 0).all(), delta
    assert (delta <= 1).all(), delta


def check_table(table: Table, folder: Path) -> None:
    """Round trips through arrays and through a file keep id and every bit; a changed value changes the id."""
    angles = sample_angles(200)
    values = table.evaluate(*angles)
    arrays = table.to_arrays()
    assert table.nbytes == sum(a.nbytes for a in arrays.values())
    copies = {name: array.copy() for name, array in arrays.items()}
    again = type(table).from_arrays(copies, table.attributes(), table.channels, table.flags)
    assert again.id == table.id
    assert _same(again.evaluate(*angles), values), "from_arrays answers differently"
    path = folder / f"{table.name}.h5"
    table.save(path)
    opened = open_table(path)
    assert opened.id == table.id
    assert _same(opened.evaluate(*angles), values), "a stored table answers differently"
    if table.local_error is not None or not table.measured_against:
        assert _same(opened.uncertainty(*angles), table.uncertainty(*angles)), "a stored table's uncertainty differs"
    assert (opened.flags, opened.channels, opened.error) == (table.flags, table.channels, table.error)
    assert (opened.source, opened.report, opened.metadata) == (table.source, table.report, table.metadata)
    check_pickle(table)
    first = next(iter(copies))
    flat = copies[first].reshape(-1)
    flat[0] = 0 if flat[0] else 1  # a step of 1 may be lost in a float16
    other = type(table).from_arrays(copies, table.attributes(), table.channels, table.flags)
    assert other.id != table.id, "another value, the same id"


def check_pickle(b: Brdf) -> None:
    """Through pickle, also after answering: the same bits, description and report."""
    angles = sample_angles(64)
    values = b.evaluate(*angles)
    again: Brdf = pickle.loads(pickle.dumps(b))
    assert type(again) is type(b)
    assert _same(again.evaluate(*angles), values), "a pickled copy answers differently"
    assert _same(again.delta_reflectance(angles[0]), b.delta_reflectance(angles[0])), "a pickled copy's delta differs"
    assert again.describe() == b.describe()
    assert again.report == b.report


def check_damage(path: Path, folder: Path, *, reads: int = 64, seed: int = 3) -> None:
    """A file cut short anywhere is refused with a clear error; one with flipped bytes is refused or read whole.

    Never anything but a `BrdfError`; a truncated file's error names the file.
    """
    data = path.read_bytes()
    target = folder / f"damaged{path.suffix}"
    rng = np.random.default_rng(seed)
    for cut in sorted({0, 1, 7, len(data) - 1, *rng.integers(0, len(data), reads).tolist()}):
        if data[:cut].strip() == data.strip():
            continue  # a text that lacks its last line break lacks nothing
        target.write_bytes(data[:cut])
        error = _error_of(lambda: read(target))
        assert isinstance(error, FileFormatError), f"{path.name} cut to {cut} of {len(data)} bytes: {error!r}"
        assert target.name in error.detail, error.detail
    for _ in range(reads):
        flipped = bytearray(data)
        for place in rng.integers(0, len(data), 4):
            flipped[place] ^= int(rng.integers(1, 256))
        target.write_bytes(flipped)
        with contextlib.suppress(BrdfError):
            read(target)


#: Indices of refraction that examples are built with: a dielectric, a metal, a metal for each of three channels.
EXAMPLE_IORS: dict[str, Any] = {"1.5": 1.5, "gold": "gold", "metals": ["gold", "copper", "silver"]}


def example_models() -> Iterator[tuple[str, Brdf]]:
    """(label, model): every registered model with its defaults, every choice of every parameter, three channels.

    A choice that is refused alone, and the model itself, are built with each of `EXAMPLE_IORS` that suits.
    `AssertionError` if a choice that a parameter declares could not be built.
    """
    for name, parameters in catalogue.models().items():
        iors = [(p.name, label, value) for p in parameters if p.kind == "ior" for label, value in EXAMPLE_IORS.items()]
        yield name, catalogue.model(name)
        for ior, label, value in iors:
            yield f"{name}-{ior}={label}", catalogue.model(name, **{ior: value})
        for parameter in parameters:
            for choice in (True, False) if parameter.kind == "flag" else parameter.choices:
                chosen, found = {parameter.name: choice}, 0
                for suffix, given in (("", {}), *((f"-{ior}={label}", {ior: value}) for ior, label, value in iors)):
                    made = _made(name, {**chosen, **given})
                    if made is not None:
                        found += 1
                        yield f"{name}-{parameter.name}={choice}{suffix}", made
                        if not given:
                            break  # it needs no other parameter beside it
                assert found, (
                    f"{name}: {parameter.name} = {choice!r} is declared, and no example could be built with it"
                )
            if parameter.kind == "number" and parameter.per_channel and isinstance(parameter.default, float):
                low, high = (x if np.isfinite(x) else parameter.default for x in parameter.bounds)
                three = [parameter.default, 0.5 * (parameter.default + low), 0.5 * (parameter.default + high)]
                made = _made(name, {parameter.name: three})
                if made is not None:
                    yield f"{name}-{parameter.name}-rgb", made


def _made(name: str, parameters: dict[str, Any]) -> Brdf | None:
    """The model, or None where it refuses these parameters; its warnings are not about the example."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        try:
            return catalogue.model(name, **parameters)
        except InputError:
            return None


def _same(a: FloatArray, b: FloatArray) -> bool:
    """Equal to the bit, 0.0 and -0.0 told apart by nobody."""
    return bool(np.array_equal(a, b, equal_nan=True))


def _refused(call: Any, where: str) -> InputError:
    error = _error_of(call)
    assert isinstance(error, InputError), f"expected an InputError about {where}, got {error!r}"
    assert error.context.get("where") == where, f"error names {error.context.get('where')!r}, expected {where!r}"
    assert error.detail, "an error without a detail"
    return error


def _error_of(call: Any) -> BrdfError | None:
    try:
        call()
    except BrdfError as error:
        return error
    return None
