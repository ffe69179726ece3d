"""`wavelengths=`: measured indices of metals, one channel a wavelength."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base.errors import InputError, UnknownNameError
from brdfcore.models.base import fresnel
from brdfcore.models.base.optical_constants import CONSTANTS, tabulated
from brdfcore.models.base.optical_tables import TABLES, table

#: Rows of the tables: Johnson & Christy 1972 and 1974 at 2.26 eV (549 nm), Rakic 1995 at 2.2 eV.
PRINTED = {
    "silver": (548.6, 0.06, 3.586),
    "gold": (548.6, 0.43, 2.455),
    "copper": (548.6, 1.02, 2.577),
    "chromium": (549.0, 3.18, 3.33),
    "nickel": (549.0, 1.92, 3.61),
    "aluminium": (563.57, 1.0728, 6.7839),
}


@pytest.mark.parametrize("name", PRINTED)
def test_a_row_is_returned_as_it_stands(name: str) -> None:
    nm, n, k = PRINTED[name]
    assert tabulated("test", name, nm)[0] == pytest.approx(complex(n, k), rel=1e-12)


@pytest.mark.parametrize("name", TABLES)
def test_tables_are_sound_and_interpolate_linearly(name: str) -> None:
    nm, n, k = table(name)
    assert (np.diff(nm) > 0).all()
    assert (n > 0).all()
    assert (k > 0).all()
    assert nm[0] < 210
    assert nm[-1] > 1900
    middle = 0.5 * (nm[10] + nm[11])
    want = complex(0.5 * (n[10] + n[11]), 0.5 * (k[10] + k[11]))
    assert tabulated("test", name, [middle])[0] == pytest.approx(want, rel=1e-12)
    np.testing.assert_array_equal(tabulated("test", name, [nm[0], nm[-1]]), [n[0] + 1j * k[0], n[-1] + 1j * k[-1]])


@pytest.mark.parametrize("name", ["chromium", "nickel", "aluminium"])
def test_constants_without_a_course_table_are_the_measured_ones(name: str) -> None:
    assert CONSTANTS[name] == pytest.approx(tabulated("test", name, 589.0)[0], abs=5e-4)


def test_gold_is_yellow_and_silver_is_white() -> None:
    """Reflectance at normal incidence: gold's edge near 500 nm, silver above 97 % all over the visible."""
    gold, silver = (bc.model("mirror", ior=n, wavelengths=[450, 550, 650]) for n in ("gold", "silver"))
    assert gold.channels == (450.0, 550.0, 650.0)
    assert gold.channels.kind == "wavelength"
    red = gold.delta_reflectance(0.0)
    assert red[0] < 0.45 < 0.75 < red[1] < red[2]
    assert (silver.delta_reflectance(0.0) > 0.97).all()


@pytest.mark.parametrize("name", ["cook_torrance", "ggx"])
def test_each_channel_is_the_model_with_that_index(name: str) -> None:
    nm = [400.0, 555.5, 700.0]
    b = bc.model(name, ior="Copper", wavelengths=nm, roughness=0.2, specular=[0.5, 0.7, 0.9])
    for k, (index, specular) in enumerate(zip(tabulated("test", "copper", nm), (0.5, 0.7, 0.9), strict=True)):
        single = bc.model(name, ior=complex(index), roughness=0.2, specular=specular)
        assert b.evaluate(0.5, 0.6, 3.0)[k] == pytest.approx(single.evaluate(0.5, 0.6, 3.0)[0], rel=1e-14)
    assert bc.model(name, ior="gold", wavelengths=550).channels == (550.0,)
    facts = json.loads(json.dumps(b.describe()))
    again = bc.model(name, **facts["metadata"]["parameters"])
    assert again.channels == b.channels
    assert again.channels.kind == "wavelength"
    np.testing.assert_array_equal(again.evaluate(0.5, 0.6, 3.0), b.evaluate(0.5, 0.6, 3.0))


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({"ior": "gold", "wavelengths": [500, 2500]}, r"187.9 to 1937 nm"),
    ({"ior": "gold", "wavelengths": [100]}, r"100 nm is outside"),
    ({"ior": "glass", "wavelengths": [500]}, "takes no wavelengths"),
    ({"ior": "steel", "wavelengths": [500]}, "takes no wavelengths"),
    ({"ior": 1.5, "wavelengths": [500]}, "is no name"),
    ({"wavelengths": [500]}, "is no name"),
    ({"ior": ["gold", "silver"], "wavelengths": [500, 600]}, "is no name"),
    ({"ior": "gold", "wavelengths": [500, 500]}, "only once"),
    ({"ior": "gold", "wavelengths": [-500]}, "wavelengths"),
    ({"ior": "gold", "wavelengths": []}, "wavelengths"),
]


@pytest.mark.parametrize("name", ["cook_torrance", "ggx", "mirror"])
@pytest.mark.parametrize(("parameters", "said"), REFUSED, ids=str)
def test_refused_wavelengths(name: str, parameters: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        bc.model(name, **parameters)


def test_other_refusals() -> None:
    with pytest.raises(UnknownNameError, match="'gold'"):
        bc.model("ggx", ior="golld", wavelengths=[500])
    with pytest.raises(InputError, match="2 wavelengths"):
        bc.model("ggx", ior="gold", wavelengths=[500, 600], roughness=[0.1, 0.2, 0.3])


def test_transmitted_fraction() -> None:
    """4 n/(n + 1)^2 at normal incidence: .96 for glass; 1 - F at every angle; 0 in total reflection."""
    assert fresnel.transmitted(1.0, 1.5) == pytest.approx(0.96, rel=1e-15)
    assert fresnel.transmitted(1.0, 2.42) == pytest.approx(4 * 2.42 / 3.42**2, rel=1e-15)
    c = np.linspace(0, 1, 50)
    for index in (1.5, 0.37 + 2.82j):
        np.testing.assert_allclose(fresnel.transmitted(c, index), 1 - fresnel.conductor(c, index), atol=1e-15)
    assert fresnel.transmitted(0.5, 1.0, 1.5) == 0
