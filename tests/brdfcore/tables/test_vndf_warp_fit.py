"""Any material in the adaptive parameterisation: its error, what is refused, and what a renderer makes of the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.conventions import HALF_PI
from brdfcore.base.errors import InputError
from brdfcore.formats.base.format import LossWarning
from brdfcore.tables.base.table import BuildOptions
from brdfcore.tables.vndf_warp import VndfWarp
from brdfcore.tables.vndf_warp.fit import WarpShape, incidence_nodes, shape_within
from tests import shared
from tests.support import rendering

GOLD = bc.model("ggx", roughness=0.1, ior=["gold", "copper", "silver"])


def error(source: bc.Brdf, table: bc.Brdf) -> float:
    return bc.compare(source, table, directions=20_000).l1


@pytest.mark.parametrize(
    ("source", "most"),
    [
        (bc.model("ggx", roughness=0.3, ior="gold"), 0.003),
        (bc.model("ggx", roughness=0.03, ior="gold"), 0.006),
        pytest.param(bc.model("oren_nayar"), 0.005, marks=pytest.mark.slow),
        pytest.param(bc.model("lambert", reflectance=[0.2, 0.5, 0.8]), 0.004, marks=pytest.mark.slow),
    ],
    ids=["ggx.3", "ggx.03", "oren_nayar", "lambert"],
)
def test_a_model_is_fitted(source: bc.Brdf, most: float) -> None:
    table = VndfWarp.build(source, BuildOptions())
    assert error(source, table) <= most
    assert table.channels == source.channels
    assert table.bilateral
    assert table.non_negative


def test_what_is_not_even_in_azimuth_and_not_reciprocal() -> None:
    class Skewed(bc.Brdf):
        bilateral = reciprocal = False

        def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
            out[:, 0] = (1 + 0.5 * np.sin(delta_phi) * np.sin(theta_i)) * (1 + 0.3 * np.cos(theta_i)) / np.pi / 2
            return True

    source = Skewed()
    table = VndfWarp.build(source, BuildOptions(shape=(17, 32)))
    assert error(source, table) < 0.01
    assert not table.bilateral
    assert not table.reciprocal


@pytest.mark.slow
def test_more_nodes_less_error() -> None:
    errors = [error(GOLD, VndfWarp.build(GOLD, BuildOptions(shape=(k, n)))) for k, n in ((9, 12), (15, 24), (26, 48))]
    assert errors[0] > 1.5 * errors[1] > 2.25 * errors[2]
    assert errors[2] < 0.004


@pytest.mark.slow
def test_a_tolerance_takes_the_smallest_that_meets_it() -> None:
    source = bc.model("oren_nayar")
    table = bc.tabulate(source, "vndf_warp", tolerance=0.03, measure="average")
    assert isinstance(table, VndfWarp)
    assert table.error["l1"] <= 0.03
    smaller = bc.tabulate(source, "vndf_warp", max_bytes=60_000)
    assert smaller.nbytes <= 60_000


def test_shapes() -> None:
    for channels in (1, 3, 31):
        for size in (1e5, 2e6):
            for file in (False, True):
                shape = shape_within(size, channels, file=file)
                assert (shape.file_bytes if file else shape.table_bytes)(channels) <= size
    table = VndfWarp.build(GOLD, BuildOptions(shape=(9, 12, 10, 20)))
    arrays = table.to_arrays()
    assert arrays["spectra"].shape[1:] == (12, 12, 3)
    assert arrays["warp"].shape[1:3] == (10, 20)
    named = ("spectra", "warp", "rows", "theta_i", "sigma", "ndf")
    held = sum(arrays[n].nbytes for n in named) - 4 * arrays["theta_i"].size
    assert held == WarpShape(arrays["theta_i"].size, 12, 10, 20).table_bytes(3)
    for bad in ((3,), (2, 3, 4), (1, 5), (100_000, 10_000)):
        with pytest.raises(InputError) as caught:
            VndfWarp.build(GOLD, BuildOptions(shape=bad))
        assert caught.value.context["where"] == "shape"
    with pytest.raises(InputError):
        shape_within(1000, 3, file=True)


def test_incidence_nodes() -> None:
    nodes = incidence_nodes(20)
    assert nodes.size == 20
    assert nodes[0] == 0
    assert nodes[-1] == np.float32(HALF_PI)
    assert (np.diff(nodes) > 0).all()
    knots = np.radians([10.0, 40.0])
    with_knots = incidence_nodes(20, knots)
    assert np.abs(with_knots[:, None] - knots).min(axis=0).max() < 1e-6
    assert 18 <= with_knots.size <= 22


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_refused(value: float) -> None:
    class Broken(bc.Brdf):
        def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
            out[:, 0] = np.where(theta_i > 1.2, value, 0.3)
            return True

    with pytest.raises(InputError, match=r"not finite|finite values"):
        VndfWarp.build(Broken(), BuildOptions(shape=(9, 12)))


def test_nothing_to_fit_is_refused() -> None:
    with pytest.raises(InputError, match="no lobe"):
        VndfWarp.build(bc.model("mirror", ior=1.5), BuildOptions())


def test_negative_samples_are_kept_or_set_to_zero() -> None:
    class Noisy(bc.Brdf):
        non_negative = False

        def _evaluate(self, theta_i: Any, theta_o: Any, delta_phi: Any, out: Any) -> bool:
            out[:, 0] = np.where(theta_o > 1.0, -0.01, 0.3)
            return True

    kept = VndfWarp.build(Noisy(), BuildOptions(shape=(9, 12)))
    assert not kept.non_negative
    zeroed = VndfWarp.build(Noisy(), BuildOptions(shape=(9, 12), negatives="zero"))
    assert zeroed.non_negative
    assert "set to zero, as asked" in zeroed.report["done"][0]


@pytest.mark.slow
def test_a_model_becomes_a_file(tmp_path: Path) -> None:
    """One channel is written as three; the file's size follows max_bytes; a mirror part is said to be lost."""
    source = bc.model("ggx", roughness=0.2, ior="gold")
    with pytest.raises(InputError, match=r"rgl .*zemax"):  # two formats end in .bsdf, and both can hold it
        bc.write(source, tmp_path / "gold.bsdf")
    back = bc.write(source, tmp_path / "gold.bsdf", format="rgl", max_bytes=300_000)
    assert isinstance(back, VndfWarp)
    assert list(back.channels) == ["R", "G", "B"]
    assert 150_000 < (tmp_path / "gold.bsdf").stat().st_size <= 300_000
    assert bc.compare(source, back, directions=20_000).l1 < 0.01
    assert "ggx" in back.metadata["description"]
    spectral = bc.model("ggx", roughness=0.3, ior="gold", wavelengths=[450.0, 550.0, 650.0, 700.0])
    again = bc.write(spectral, tmp_path / "spectral.bsdf", format="rgl", max_bytes=200_000)
    assert again.channels == spectral.channels
    with pytest.warns(LossWarning, match="mirror part"):
        bc.write(source + bc.model("mirror", ior=1.5), tmp_path / "both.bsdf", format="rgl", max_bytes=50_000)
    bc.write(GOLD, tmp_path / "rgb.bsdf", max_bytes=100_000)  # of the two only this one holds R, G, B
    assert bc.sniff(tmp_path / "rgb.bsdf") == "rgl"


#: f of a file in Mitsuba's measured, at the angles of an .npy: in a process of its own, as its compiler may end it.
RENDERED = """
import sys
import numpy as np, drjit as dr, mitsuba as mi
mi.set_variant("llvm_ad_rgb")
bsdf = mi.load_dict({"type": "measured", "filename": sys.argv[1]})
theta_i, theta_o, delta_phi = np.load(sys.argv[2]).astype(np.float32)
si = dr.zeros(mi.SurfaceInteraction3f, theta_i.size)
si.wi = mi.Vector3f(np.sin(theta_i), np.zeros_like(theta_i), np.cos(theta_i))
wo = mi.Vector3f(np.sin(theta_o) * np.cos(delta_phi), np.sin(theta_o) * np.sin(delta_phi), np.cos(theta_o))
np.save(sys.argv[3], np.array(bsdf.eval(mi.BSDFContext(), si, wo)).T / np.cos(theta_o)[:, None])
"""


def rendered(path: Path, folder: Path, angles: tuple[Any, Any, Any]) -> Any:
    np.save(folder / "angles.npy", np.stack(angles))
    rendering.run(RENDERED, path, folder / "angles.npy", folder / "out.npy")
    return np.load(folder / "out.npy")


@pytest.mark.slow
def test_mitsuba_reads_it_and_answers_as_the_source(tmp_path: Path) -> None:
    if why := rendering.unusable():
        pytest.skip(why)
    sources = {"gold": GOLD, "white": bc.model("oren_nayar")}
    if shared.RGL.exists():  # a measured file, seen as a function
        sources["paint"] = 1.0 * bc.read(shared.rgl_path("vch_golden_yellow"))
    rng = np.random.default_rng(5)
    n = 20_000
    theta_i = np.arcsin(np.sqrt(rng.uniform(0.001, 0.98, n)))
    wi = np.stack([np.sin(theta_i), np.zeros(n), np.cos(theta_i)], axis=-1)
    for name, source in sources.items():
        path = tmp_path / f"{name}.bsdf"
        table = bc.write(source, path, format="rgl")
        assert path.stat().st_size <= 2_000_000
        drawn = source.sample(wi, rng.random((n, 2)))
        theta_o = np.arccos(np.clip(drawn.wo[:, 2], 0.01, 1))
        angles = (theta_i, theta_o, np.arctan2(drawn.wo[:, 1], drawn.wo[:, 0]))
        found, expected = rendered(path, tmp_path, angles), source.evaluate(*angles)
        weight = (np.cos(theta_o) / drawn.pdf)[:, None]
        l1 = float((np.abs(found - expected) * weight).sum() / np.broadcast_to(expected * weight, found.shape).sum())
        assert l1 < 0.005, (name, l1)
        ours = table.evaluate(*angles)
        off = np.abs(found - ours) / (np.abs(ours) + 0.01 * np.abs(ours).mean())
        assert np.median(off) < 2e-5, name
