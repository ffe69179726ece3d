"""Names, parameters and what a wrong one says."""

from __future__ import annotations

import json
from importlib.metadata import EntryPoint

import numpy as np
import pytest

import brdfcore as bc
from brdfcore.base import registry
from brdfcore.base.parameters import Parameter, resolve


def test_close_names_on_a_miss() -> None:
    with pytest.raises(bc.UnknownNameError, match=r"did you mean 'cook_torrance'\?"):
        bc.model("cook_torance")
    with pytest.raises(bc.UnknownNameError, match=r"has no parameter 'rougness'; it takes: .*roughness"):
        bc.model("cook_torrance", rougness=0.1)
    with pytest.raises(KeyError):  # either kind of except is right
        bc.model("nothing like it")


def test_other_packages_add_entries(monkeypatch: pytest.MonkeyPatch) -> None:
    plugin = EntryPoint("their_model", "brdfcore.models.lambert:Lambert", "brdfcore.models")
    taken = EntryPoint("lambert", "brdfcore.models.mirror:Mirror", "brdfcore.models")
    monkeypatch.setattr(registry, "_plugins", lambda group: {e.name: e for e in (plugin, taken)})
    assert "their_model" in bc.models()
    assert bc.model("their_model", reflectance=0.5).albedo(0.0)[0] == pytest.approx(0.5)
    assert bc.model("lambert").metadata["model"] == "lambert", "a built-in name was taken over"


def test_every_parameter_describes_itself_as_json() -> None:
    listed = [*bc.models().values(), *bc.representations().values(), *bc.formats().values()]
    for parameters in listed:
        json.dumps([p.to_json() for p in parameters], allow_nan=False)


NUMBER = Parameter("m", "m", "a width", 0.5, bounds=(0, 1), open_bounds=("low",), aliases=("alpha",))
CHOICE = Parameter("kind", "", "which", "a", kind="choice", choices=("a", "b"))
COUNT = Parameter("n", "", "how many", 3, kind="integer", bounds=(1, 9))


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"m": 0}, "(0, 1]"),
        ({"m": 1.001}, "(0, 1]"),
        ({"m": float("nan")}, "(0, 1]"),
        ({"m": [0.1, 2.0]}, "(0, 1]"),
        ({"m": "text"}, "a number"),
        ({"m": True}, "a number"),
        ({"m": None}, "a number"),
        ({"m": []}, "one number"),
        ({"m": [[0.1]]}, "one number"),
        ({"m": {}}, "a number"),
        ({"kind": "c"}, "one of 'a', 'b'"),
        ({"kind": 1}, "one of 'a', 'b'"),
        ({"n": 2.5}, "a whole number"),
        ({"n": 10}, "[1, 9]"),
        ({"n": [1, 2]}, "one number"),
    ],
)
def test_a_value_out_of_bounds_is_named(given: dict[str, object], expected: str) -> None:
    with pytest.raises(bc.InputError) as caught:
        resolve("owner", (NUMBER, CHOICE, COUNT), given)
    assert caught.value.context["where"] == next(iter(given))
    assert expected in caught.value.context["expected"]
    assert caught.value.detail.startswith("owner: ")


def test_canonical_values() -> None:
    values = resolve("owner", (NUMBER, CHOICE, COUNT), {"alpha": [0.1, 1], "n": 4.0})
    assert np.array_equal(values["m"], [0.1, 1.0])
    assert not values["m"].flags.writeable
    assert (values["kind"], values["n"]) == ("a", 4)
    assert resolve("owner", (NUMBER,), {"m": np.float32(0.25)}) == {"m": 0.25}
    with pytest.raises(bc.InputError, match="given twice"):
        resolve("owner", (NUMBER,), {"m": 0.1, "alpha": 0.1})
