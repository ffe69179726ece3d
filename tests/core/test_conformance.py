"""Every registry entry, held to what it claims (`brdfcore.testing`)."""

from __future__ import annotations

from pathlib import Path

import pytest

import brdfcore as bc
from brdfcore import testing

MODELS = dict(testing.example_models())


@pytest.mark.parametrize("name", MODELS)
def test_model(name: str) -> None:
    testing.check_brdf(MODELS[name])


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
