"""Every registry entry, held to what it claims (`brdfcore.testing`)."""

from __future__ import annotations

import warnings
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import brdfcore as bc
from brdfcore import testing
from brdfcore.base.parameters import Parameter
from brdfcore.base.registry import FORMATS, REPRESENTATIONS
from brdfcore.formats.base.format import LossWarning
from brdfcore.formats.base.regrid import to_brdf
from brdfcore.formats.rgl.tensor_file import encode
from tests.support import goniometer
from tests.support.rgl_synthetic import fields_of
from tests.support.tiers import first_fast

MODELS = dict(testing.example_models())


@pytest.mark.parametrize("name", MODELS)
def test_model(name: str) -> None:
    testing.check_brdf(MODELS[name])
    testing.check_pickle(MODELS[name])
    assert not MODELS[name].uncertainty(*testing.sample_angles(64)).any()  # a formula is not off


@pytest.mark.parametrize("name", [pytest.param(n, marks=() if n in bc.models() else pytest.mark.slow) for n in MODELS])
def test_model_sampling(name: str) -> None:
    testing.check_sampling(MODELS[name])


def test_examples_reach_every_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also those that need an index of refraction; one that nothing reaches is a failure, not a silent gap."""
    for wanted in (
        "fresnel=conductor-ior=gold",
        "fresnel=dielectric-ior=1.5",
        "fresnel=schlick-ior=metals",
        "ior=gold",
    ):
        assert f"cook_torrance-{wanted}" in MODELS
    assert MODELS["cook_torrance-ior=metals"].channels == ("R", "G", "B")

    def refused(name: str, **parameters: object) -> bc.Brdf:
        if parameters:
            raise bc.InputError("bad_parameter", "refused")
        return MODELS["lambert"]

    choice = Parameter("way", "", "how", "a", kind="choice", choices=("a",))
    monkeypatch.setattr(testing.catalogue, "models", lambda: {"lambert": (choice,)})
    monkeypatch.setattr(testing.catalogue, "model", refused)
    with pytest.raises(AssertionError, match="way = 'a' is declared"):
        list(testing.example_models())


@pytest.mark.parametrize("key", ["self", "name"])
def test_a_model_file_with_the_name_of_an_argument(key: str, tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    path.write_text(f'{{"model": "lambert", "parameters": {{"{key}": 1}}}}')
    with pytest.raises(bc.FileFormatError, match=f"no model has a parameter '{key}'"):
        bc.read(path)


@pytest.mark.parametrize("name", bc.models())
def test_model_documents_itself(name: str) -> None:
    entry = type(bc.model(name))
    assert entry.SUMMARY
    assert entry.FORMULA
    assert entry.REFERENCE
    assert entry.__doc__
    for parameter in entry.PARAMETERS:
        assert parameter.meaning, parameter.name


@pytest.mark.parametrize("name", bc.models())
def test_model_file_round_trip(name: str, tmp_path: Path) -> None:
    source = bc.model(name)
    bc.write(source, tmp_path / "m.json")
    again = bc.read(tmp_path / "m.json")
    angles = testing.sample_angles(64)
    assert (again.evaluate(*angles) == source.evaluate(*angles)).all()
    assert (again.delta_reflectance(angles[0]) == source.delta_reflectance(angles[0])).all()


#: Bytes of the tables that are examined here: a representation's own size may be many megabytes.
ROOM = 300_000


@pytest.fixture(scope="module")
def materials(tmp_path_factory: pytest.TempPathFactory) -> list[bc.Brdf]:
    """One material of each kind: a model, tables of it, a measured file, scattered measurements."""
    gold = bc.model("cook_torrance", roughness=0.4, ior="gold")
    measured = tmp_path_factory.mktemp("measured") / "m.bsdf"
    measured.write_bytes(encode(fields_of()))
    small = bc.tabulate(gold, "half_angle_grid", shape=(8, 7, 12))
    listed = to_brdf(goniometer.measured(goniometer.paint(), lights=4, viewers=4, turns=4))
    nodes = bc.tabulate(gold, "node_grid", shape=(6, 6, 8))
    patches = tmp_path_factory.mktemp("patches") / "p.xml"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LossWarning)
        bc.write(bc.model("lambert", reflectance=0.3), patches, basis="quarter")
    table = bc.tabulate(gold, "angle_grid", shape=(16, 16, 31))
    return [gold, table, small, bc.read(measured), listed, nodes, bc.read(patches)]


@pytest.mark.parametrize("many", first_fast(False, True), ids=["one", "all"])
@pytest.mark.parametrize("name", bc.representations())
def test_representation(name: str, many: bool, materials: list[bc.Brdf], tmp_path: Path) -> None:
    """Built from every material it can hold, with every interpolation it offers, or from the first; a table answers to
    the same suites as a model."""
    entry = REPRESENTATIONS.load(name)
    assert entry.SUMMARY
    held = [m for m in materials if entry.can_hold(m)]
    assert held, f"no example material for {name}: add one to the fixture"
    offered = {p.name: p.choices for p in entry.PARAMETERS}.get("interpolation", ("linear",))
    for source, interpolation in product(held, offered) if many else [(held[0], offered[0])]:
        table = bc.tabulate(
            source, name, interpolation=interpolation, max_bytes=ROOM if many or name == "scattered" else ROOM // 8
        )
        assert table.name == name
        testing.check_brdf(table, steps=interpolation == "nearest")
        testing.check_table(table, tmp_path)
        if interpolation == "linear":
            testing.check_sampling(table)
    with pytest.raises(bc.InputError) as refused:
        bc.tabulate(held[0], name, interpolation="no such thing")
    assert refused.value.context["where"] == "interpolation"


#: Formats of rows are fitted anew at each reading: seconds, and much the same for all of them.
ROWS = ("astm", "openmaterial")


@pytest.mark.parametrize(
    ("name", "many"),
    [
        *(pytest.param(n, False, marks=pytest.mark.slow if n in ROWS else (), id=f"{n}-one") for n in bc.formats()),
        *(pytest.param(n, True, marks=pytest.mark.slow, id=f"{n}-all") for n in bc.formats()),
    ],
)
def test_format(name: str, many: bool, materials: list[bc.Brdf], tmp_path: Path) -> None:
    """What it writes it knows again, reads to the same bits, writes to the same bytes, and refuses when damaged; for
    every material that it holds, or the first of them.

    A format that samples anew reads to the same bits what it has written of its own layout.
    """
    entry = FORMATS.load(name)()
    assert entry.SUMMARY
    if not entry.writable:
        pytest.skip(f"format {name!r} is read only")
    written = 0
    for source in materials:
        path, again = (tmp_path / f"{stem}{entry.EXTENSIONS[0]}" for stem in ("one", "two"))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", LossWarning)
            try:
                bc.write(source, path, format=name)
            except bc.InputError:  # not a kind of material that this format holds
                continue
            written += 1
            assert bc.sniff(path) == name
            back = bc.read(path)
            bc.write(back, again, format=name)
        angles = testing.sample_angles(100)
        if entry.keeps_every_bit(source):
            assert np.array_equal(back.evaluate(*angles), source.evaluate(*angles))
            assert back.channels == source.channels
        assert np.array_equal(bc.read(again).evaluate(*angles), back.evaluate(*angles))
        assert again.read_bytes() == path.read_bytes()
        # a large file takes a tenth of a second each time it is damaged
        testing.check_damage(path, tmp_path, reads=64 if many and path.stat().st_size < 200_000 else 2)
        if not many:
            break
    assert written, f"no example material for format {name!r}: add one to the fixture"
