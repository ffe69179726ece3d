"""A scene file: which materials, how each is seen, and what may be spent on them.

    {
      "angles": "deg",                                    unit of the ranges: "deg" (default) or "rad"
      "budget": {"error": 0.01, "bytes": 5e6, "ns": 20},  error (L1) of each material, default 0.01; bytes of all tables
                                                          together; longest time of a look-up, ns, on one core
      "materials": [
        {"name": "wall", "model": "lambert", "parameters": {"reflectance": 0.8}},
        {"name": "car", "file": "paint.bsdf",             a file beside the scene file, or an absolute path
         "light": [0, 80], "view": [10, 60],              ranges of theta_i and theta_o; default 0 to 90 degrees
         "lighting": "environment",                       or "lamps" (default): what it is lit by
         "channels": ["G"],                               names, or wavelengths in nm; default: all
         "error": 0.02}                                   instead of the budget's
      ]
    }

A name is what the service takes: 1 to 64 letters, digits, dots, hyphens or underscores. `budget` may lack any of its
three, and every key of a material but `name` and one of `model` and `file` may be left out.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.catalogue import model
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import BrdfError, FileFormatError, InputError, StorageError
from brdfcore.build.tabulate import DEFAULT_TOLERANCE
from brdfcore.formats.io.files import read
from brdfcore.names import MATERIAL_NAME

NAME = re.compile(MATERIAL_NAME)
#: Far above any scene that a person writes; a larger file is something else.
MAX_BYTES, MAX_MATERIALS = 10_000_000, 1_000
_MATERIAL_KEYS = ("name", "model", "parameters", "file", "light", "view", "lighting", "channels", "error")
_BUDGET_KEYS = ("error", "bytes", "ns")

Lighting = Literal["lamps", "environment"]


@dataclass(frozen=True)
class SceneMaterial:
    """One material of a scene; ranges in radians. `identity` is the same for equal materials."""

    name: str
    brdf: Brdf
    identity: str
    path: Path | None
    light: tuple[float, float]
    view: tuple[float, float]
    lighting: Lighting
    channels: tuple[Any, ...] | None
    error: float


@dataclass(frozen=True)
class Scene:
    """Materials and budget; None where nothing is asked."""

    materials: tuple[SceneMaterial, ...]
    error: float
    bytes: float | None
    ns: float | None


class Selected(Brdf):
    """Some channels of a material, in the order asked for."""

    def __init__(self, part: Brdf, picks: list[int]) -> None:
        super().__init__()
        self.part, self.picks = part, picks
        self.channels = Channels([part.channels[k] for k in picks], part.channels.kind)
        self.bilateral, self.reciprocal = part.bilateral, part.reciprocal
        self.energy_conserving, self.non_negative = part.energy_conserving, part.non_negative
        self.has_delta = part.has_delta
        self.metadata, self.report = dict(part.metadata), dict(part.report)

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[...] = self.part.evaluate(theta_i, theta_o, delta_phi)[:, self.picks]
        return True

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        return self.part._status(theta_i, theta_o, delta_phi)

    def _uncertainty(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[...] = self.part.uncertainty(theta_i, theta_o, delta_phi)[:, self.picks]
        return True

    def _delta_reflectance(self, theta_i: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return self.part._delta_reflectance(theta_i)[:, self.picks]


def read_scene(scene: Mapping[str, Any] | str | Path) -> Scene:
    """A scene from a file or from its content; files of materials are sought beside the scene file.

    Raises `InputError` whose `where` is the path of the offending value ("materials[3].view"), `FileFormatError` for
    what is no JSON, `StorageError` for a file that cannot be opened, and what reading a material raises.
    """
    base = Path()
    if isinstance(scene, (str, Path)):
        base = Path(scene).parent
        scene = _loaded(Path(scene))
    content = _object("scene", scene, ("angles", "budget", "materials"))
    unit = content.get("angles", "deg")
    if unit not in ("deg", "rad"):
        raise _bad("angles", unit, "'deg' or 'rad'")
    budget = _object("budget", content.get("budget", {}), _BUDGET_KEYS)
    limits = {key: _positive(f"budget.{key}", budget[key]) for key in _BUDGET_KEYS if budget.get(key) is not None}
    error = limits.get("error", DEFAULT_TOLERANCE)
    listed = content.get("materials")
    if not isinstance(listed, list) or not 0 < len(listed) <= MAX_MATERIALS:
        raise _bad("materials", listed, f"a list of 1 to {MAX_MATERIALS} materials")
    seen: dict[str, int] = {}
    materials = []
    for k, given in enumerate(listed):
        made = _material(f"materials[{k}]", given, base, unit, error)
        if made.name in seen:
            taken = f"a name of its own: materials[{seen[made.name]}] has this one"
            raise _bad(f"materials[{k}].name", made.name, taken)
        seen[made.name] = k
        materials.append(made)
    return Scene(tuple(materials), error, limits.get("bytes"), limits.get("ns"))


def _loaded(path: Path) -> Any:
    try:
        with path.open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise StorageError("cannot_open", f"{path}: {error.strerror or error}", where=str(path)) from error
    if len(raw) > MAX_BYTES:
        raise FileFormatError("bad_scene", f"{path.name}: a scene has at most {MAX_BYTES} bytes", where=path.name)
    try:
        return json.loads(raw)
    except (ValueError, RecursionError) as error:
        place: Any = error
        if isinstance(error, json.JSONDecodeError):
            place = f"line {error.lineno}, column {error.colno}: {error.msg}"
        raise FileFormatError("bad_scene", f"{path.name}: not JSON ({place})", where=path.name) from error


def _material(where: str, given: Any, base: Path, unit: str, error: float) -> SceneMaterial:
    entry = _object(where, given, _MATERIAL_KEYS)
    name = entry.get("name")
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise _bad(f"{where}.name", name, "1 to 64 letters, digits, dots, hyphens or underscores, e.g. 'wall'")
    if ("model" in entry) == ("file" in entry):
        raise _bad(where, sorted(entry), "either 'model' (with 'parameters') or 'file'")
    path = None
    try:
        if "model" in entry:
            brdf, identity = _model(where, entry)
        else:
            path = base / _text(f"{where}.file", entry["file"])
            brdf, identity = read(path), _digest(path)
    except BrdfError as problem:
        problem.detail = problem.detail if problem.detail.startswith(where) else f"{where}: {problem.detail}"
        problem.args = (problem.detail,)
        raise
    lighting = entry.get("lighting", "lamps")
    if lighting not in ("lamps", "environment"):
        raise _bad(f"{where}.lighting", lighting, "'lamps' or 'environment'")
    return SceneMaterial(
        name,
        brdf,
        identity,
        path,
        _range(f"{where}.light", entry.get("light"), unit),
        _range(f"{where}.view", entry.get("view"), unit),
        lighting,
        _channels(f"{where}.channels", entry.get("channels"), brdf),
        _positive(f"{where}.error", entry["error"]) if entry.get("error") is not None else error,
    )


def _model(where: str, entry: Mapping[str, Any]) -> tuple[Brdf, str]:
    name, parameters = _text(f"{where}.model", entry["model"]), entry.get("parameters", {})
    if not isinstance(parameters, dict) or {"name", "self"} & set(parameters):
        raise _bad(f"{where}.parameters", parameters, "an object of parameters of the model")
    try:
        brdf = model(name, **parameters)
    except (TypeError, ValueError, ArithmeticError) as error:
        if isinstance(error, BrdfError):
            raise
        raise _bad(f"{where}.parameters", parameters, "values that the model takes") from error
    resolved = {k: v for k, v in brdf.metadata["parameters"].items() if k != "precision"}
    return brdf, json.dumps([name, resolved], sort_keys=True, default=str)


def _digest(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(1 << 20):
            digest.update(piece)
    return digest.hexdigest()


def _channels(where: str, given: Any, brdf: Brdf) -> tuple[Any, ...] | None:
    """Items of the material's own channels."""
    if given is None:
        return None
    if not isinstance(given, list) or not given:
        raise _bad(where, given, f"a list of some of {', '.join(brdf.channels.labels())}")
    picks: list[int] = []
    for item in given:
        usable = isinstance(item, (str, int, float)) and item is not True and item is not False
        found = [k for k, c in enumerate(brdf.channels) if usable and c == item]
        if not found or found[0] in picks:
            raise _bad(where, item, f"some of {', '.join(brdf.channels.labels())}, each once")
        picks.append(found[0])
    return tuple(brdf.channels[k] for k in sorted(picks))


def _range(where: str, given: Any, unit: str) -> tuple[float, float]:
    top = 90.0 if unit == "deg" else math.pi / 2
    if given is None:
        return 0.0, 1.6  # past float32's pi/2
    numbers = isinstance(given, list) and len(given) == 2
    numbers = numbers and all(isinstance(x, (int, float)) and not isinstance(x, bool) for x in given)
    # a little past pi/2: a quarter turn in as many digits as people write
    if not numbers or not 0 <= given[0] < given[1] <= top * (1 + 1e-3):
        words = "degrees" if unit == "deg" else "radians"
        raise _bad(where, given, f"[from, to] with 0 <= from < to <= {top:.4g} ({words})")
    low, high = (math.radians(x) if unit == "deg" else float(x) for x in given)
    return low, 1.6 if given[1] >= top * (1 - 1e-9) else high


def _object(where: str, given: Any, keys: tuple[str, ...]) -> Mapping[str, Any]:
    if not isinstance(given, Mapping):
        raise _bad(where, given, f"an object with {', '.join(keys)}")
    unknown = [k for k in given if k not in keys]
    if unknown:
        raise _bad(f"{where}.{str(unknown[0])[:40]}", given[unknown[0]], f"one of the keys {', '.join(keys)}")
    return given


def _text(where: str, given: Any) -> str:
    if not isinstance(given, str) or not given or "\0" in given:
        raise _bad(where, given, "a text")
    return given


def _positive(where: str, given: Any) -> float:
    try:
        number = float(given) if isinstance(given, (int, float)) and not isinstance(given, bool) else math.nan
    except OverflowError:
        number = math.inf
    if not 0 < number < math.inf:
        raise _bad(where, given, "a finite number > 0")
    return number


def _bad(where: str, got: Any, expected: str) -> InputError:
    shown = json.dumps(got, default=str)[:80] if got is not None else "nothing"
    return InputError(
        "bad_scene", f"{where}: expected {expected}; got {shown}", where=where, got=shown, expected=expected
    )
