"""A model with a fast lobe, a representation and a format, as another package would bring them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.base.geometry import PairGeometry
from brdfcore.base.parameters import Parameter
from brdfcore.formats.base.format import Format, read_bytes
from brdfcore.models.base.model import FastArguments, Model, channels_for
from brdfcore.tables.base.table import BuildOptions, Progress, Table

Float64Array = npt.NDArray[np.float64]


class Sheen(Model):
    """f = weight (1 + tan^2 theta_h)^-1 = weight cos^2 theta_h, 1/sr."""

    name = "sheen"
    PARAMETERS = (Parameter("weight", "w", "f at the mirror direction", 0.1, bounds=(0.0, 0.3)),)
    SUMMARY = "A lobe as wide as it gets."
    FORMULA = "f = weight cos^2 theta_h"
    REFERENCE = "none"
    FAST: ClassVar[str] = "tests.support.sheen_kernel:sheen"

    def __init__(self, /, **parameters: Any) -> None:
        super().__init__(**parameters)
        self.channels = channels_for(self.name, self.parameters["weight"])
        self._weight = np.atleast_1d(self.parameters["weight"])

    def _value(self, pair: PairGeometry) -> Float64Array:
        return np.asarray(self._weight / (1 + pair.tan2_h[:, None]))

    def _fast_arguments(self) -> FastArguments:
        return FastArguments(self._weight, 0 * self._weight, np.zeros((len(self.channels), 1), np.float32), (0,))


class Grey(Table):
    """The same value everywhere: the albedo at normal incidence over pi."""

    name = "grey"
    SUMMARY = "one value a channel"
    FOR_AUTO = False

    def __init__(self, value: Float64Array, channels: Channels, flags: Mapping[str, bool]) -> None:
        super().__init__(channels, flags)
        self.value = value

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[...] = self.value
        return True

    def to_arrays(self) -> dict[str, npt.NDArray[Any]]:
        return {"value": self.value}

    @classmethod
    def from_arrays(
        cls,
        arrays: Mapping[str, npt.NDArray[Any]],
        attributes: Mapping[str, Any],
        channels: Channels,
        flags: Mapping[str, bool],
    ) -> Self:
        value = arrays.get("value")
        if value is None or value.dtype != np.float64 or value.shape != (len(channels),):
            raise FileFormatError("bad_field", "grey: expected one float64 a channel", where="value")
        return cls(value, channels, flags)

    @classmethod
    def build(cls, source: Brdf, options: BuildOptions, progress: Progress | None = None) -> Self:
        flags = dict.fromkeys(("bilateral", "reciprocal", "energy_conserving", "non_negative"), True)
        return cls(source.albedo(0.0) / np.pi, source.channels, flags)


class GreyFile(Format):
    """JSON {"grey": [values], "channels": [names]}."""

    name = "grey_file"
    SUMMARY = "one value a channel, as text"
    EXTENSIONS = (".grey",)
    writable = True

    def sniff(self, head: bytes) -> bool:
        return head.startswith(b'{"grey"')

    def read(self, path: Path, **options: Any) -> Brdf:
        found = json.loads(read_bytes(path, 10_000))
        flags = dict.fromkeys(("bilateral", "reciprocal", "energy_conserving", "non_negative"), True)
        made = Grey(np.array(found["grey"]), Channels(found["channels"]), flags)
        made.report = {"format": self.name, "file": path.name, "done": [], "warnings": []}
        return made

    def can_write(self, brdf: Brdf) -> bool:
        return isinstance(brdf, Grey)

    def write(self, brdf: Brdf, path: Path, **options: Any) -> None:
        if not isinstance(brdf, Grey):
            raise InputError("not_grey", f"a .grey file holds a grey table, not {brdf!r:.80}", where="brdf")
        write_file(path, json.dumps({"grey": brdf.value.tolist(), "channels": brdf.channels.to_json()}).encode())
