"""How numbers, names, lines and radial scales look in every picture."""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.registry import MODELS
from brdfcore.names import Scale

#: P. Tol's high- and medium-contrast colours: apart for colour-blind readers and in greyscale. Line styles
#: double the distinction, so that a photocopy is still readable.
COLOURS = ("#004488", "#BB5566", "#DDAA33", "#000000", "#6699CC", "#997700")
STYLES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (1.5, 1.3)), (0, (7, 2, 1.5, 2)), (0, (4, 1.5, 1, 1.5, 1, 1.5)))
#: Channels that are colours are drawn in their colour, darkened until it shows on white paper.
CHANNEL_COLOURS = {"R": "#CC3311", "G": "#228833", "B": "#0044AA"}
INK, FAINT, RING = "#222222", "#666666", "#C8C8C8"
COLOUR_MAP = "viridis"  # lightness rises monotonically: prints in grey

#: Everything that matplotlib would otherwise take from the user's matplotlibrc and that changes the bytes.
RC = {
    "font.family": ["sans-serif"],
    "font.sans-serif": ["DejaVu Sans"],  # comes with matplotlib: the same picture on every machine
    "font.size": 9.0,
    "svg.hashsalt": "brdf-tables",
    "svg.fonttype": "path",
    "text.color": INK,
    "axes.linewidth": 0.8,
}

_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number_text(value: float) -> str:
    """`value` to four digits as a label prints it: 0.25, 1500, 2.5×10⁶, 10⁻³."""
    if value == 0 or not math.isfinite(value):
        return "0" if value == 0 else str(value)
    if 1e-3 <= abs(value) < 1e5:
        return f"{value:.4g}" if abs(value) < 1e4 else f"{value:.0f}"
    mantissa, exponent = f"{value:.3e}".split("e")
    mantissa = mantissa.rstrip("0").rstrip(".")
    power = "10" + str(int(exponent)).translate(_SUPERSCRIPT)
    return power if mantissa == "1" else f"{mantissa}×{power}"


def degrees_text(radians: float) -> str:
    """An angle as a label prints it: 30°, 12.5°."""
    return f"{float(np.degrees(radians)):.6g}°"


def clean(text: str, longest: int = 90) -> str:
    """`text` on one line, printable (control characters are no valid XML), not longer than `longest`."""
    text = " ".join(unicodedata.normalize("NFC", str(text)).split())
    text = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
    return text if len(text) <= longest else text[: longest - 1] + "…"


def name_of(b: Brdf) -> str:
    """What a title calls a material that was given no name: its model and parameters, or its file."""
    source = getattr(b, "source", {})
    name = _name_in(b.metadata) or _name_in(b.report) or (_name_in(source) if isinstance(source, dict) else "")
    return clean(name or type(b).__name__)


def _name_in(data: Mapping[str, Any]) -> str:
    """The name that metadata, a report or a sum's or multiple's metadata holds; "" if none."""
    if isinstance(data.get("model"), str):
        given = data.get("parameters")
        given = _not_default(str(data["model"]), given if isinstance(given, dict) else {})
        listed = ", ".join(f"{k} {_parameter_text(v)}" for k, v in given.items())
        return f"{data['model']}: {listed}" if listed else str(data["model"])
    if isinstance(data.get("sum"), list):
        return " + ".join(_name_in(part) or "?" for part in data["sum"])
    if isinstance(data.get("scaled"), dict):
        factor = data.get("factor", [])
        text = _parameter_text(factor[0] if len(factor) == 1 else factor)
        return f"{text} × ({_name_in(data['scaled']) or '?'})"
    return next((data[k] for k in ("name", "title", "file") if isinstance(data.get(k), str)), "")


def _not_default(model: str, given: dict[str, Any]) -> dict[str, Any]:
    """The parameters worth a place in a title."""
    defaults = {p.name: p.default for p in MODELS.load(model).PARAMETERS} if model in MODELS else {}
    return {k: v for k, v in given.items() if k not in defaults or v != defaults[k]}


def _parameter_text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list):
        return "[" + ", ".join(_parameter_text(x) for x in value) + "]"
    return str(value)


def default_channel(channels: Channels) -> int:
    """The one channel drawn where only one can be: the middle one, G of R, G, B."""
    return len(channels) // 2


def line_looks() -> Iterator[tuple[str, Any]]:
    """Colour and line style, all different for the first thirty lines."""
    for k in count():
        yield COLOURS[k % len(COLOURS)], STYLES[(k + k // len(COLOURS)) % len(STYLES)]


def at_horizon(theta_o: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """True within a tenth of a degree of the horizon."""
    return np.asarray(np.abs(theta_o) > np.radians(89.9))


@dataclass(frozen=True)
class Radial:
    """A map from values to [0, 1], with its ticks; `low` to `high` are values (linear) or decades (log)."""

    scale: Scale
    low: float
    high: float
    ticks: tuple[float, ...]

    @staticmethod
    def fit(
        values: npt.NDArray[np.float64],
        scale: Scale,
        horizon: npt.NDArray[np.bool_] | None = None,
        most_decades: int = 6,
    ) -> Radial:
        """The range of `values`; a log scale ends at least two and at most `most_decades` decades below its top.

        horizon  marks values at the horizon. Measured data divided by cos theta_o can be 1e14 there: they count
                 only if they are no more than ten times the rest, otherwise they would be all one sees.
        """
        usable = np.isfinite(values) & (values > 0)
        positive = values[usable]
        if horizon is not None and (inner := values[usable & ~horizon]).size and positive.max() > 10 * inner.max():
            positive = inner
        if scale == "linear":
            largest = float(positive.max()) if positive.size else 1.0
            step = _nice_step(largest / 4)
            rings = math.ceil(largest / step * (1 - 1e-9))
            return Radial(scale, 0.0, rings * step, tuple(k * step for k in range(rings + 1)))
        if not positive.size:
            return Radial(scale, -1.0, 0.0, (-1.0, 0.0))
        top = math.ceil(math.log10(float(positive.max())) - 1e-12)
        bottom = math.floor(math.log10(float(positive.min())) + 1e-12)
        bottom = max(min(bottom, top - 2), top - most_decades)
        return Radial(scale, float(bottom), float(top), tuple(float(k) for k in range(bottom, top + 1)))

    def __call__(self, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Radii. NaN where nothing is drawn: not finite, negative, above the top, or zero on a log scale; 0 below a
        log floor."""
        radii = np.full(values.shape, np.nan)
        shown = np.isfinite(values) & ((values >= 0) if self.scale == "linear" else (values > 0)) & ~self._above(values)
        x = values[shown] if self.scale == "linear" else np.log10(values[shown])
        radii[shown] = np.maximum((x - self.low) / (self.high - self.low), 0.0)
        return radii

    def clipped(self, values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Radii of ends of intervals, held to [0, 1]; what is not finite is at an end too."""
        top = self.high if self.scale == "linear" else 10.0**self.high
        held = np.clip(np.nan_to_num(values, nan=0.0, posinf=top, neginf=0.0), self.floor, top)
        x = held if self.scale == "linear" else np.log10(held)
        return np.asarray((x - self.low) / (self.high - self.low))

    def _above(self, values: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        top = self.high if self.scale == "linear" else 10.0**self.high
        with np.errstate(invalid="ignore"):
            above: npt.NDArray[np.bool_] = values > top * (1 + 1e-9)
        return above & np.isfinite(values)

    @property
    def floor(self) -> float:
        """Value at the centre, 1/sr."""
        return 0.0 if self.scale == "linear" else 10.0**self.low

    def tick_values(self) -> list[float]:
        return [t if self.scale == "linear" else 10.0**t for t in self.ticks]

    def tick_labels(self) -> list[str]:
        if self.scale == "linear":
            return [number_text(t) for t in self.ticks]
        return ["10" + str(int(t)).translate(_SUPERSCRIPT) for t in self.ticks]

    def notes(self, values: npt.NDArray[np.float64]) -> list[str]:
        """One sentence for each kind of value that the picture does not show at its true place."""
        missing = int((~np.isfinite(values)).sum())
        finite = values[np.isfinite(values)]
        lines = []
        if self.scale == "log":
            none, under = int((finite <= 0).sum()), int(((finite > 0) & (finite < self.floor)).sum())
            if none:
                lines.append(f"{none} of {values.size} values ≤ 0 not drawn")
            if under:
                lines.append(f"{under} of {values.size} values below {number_text(self.floor)} lie in the centre")
        elif (negative := int((finite < 0).sum())) > 0:
            lines.append(
                f"{negative} of {values.size} values < 0 not drawn (least: {number_text(float(finite.min()))})"
            )
        if (above := self._above(values)).any():
            most = number_text(float(values[above].max()))
            lines.append(f"{int(above.sum())} of {values.size} values at the horizon (up to {most}) not drawn")
        if missing:
            lines.append(f"{missing} of {values.size} values not finite, not drawn")
        return lines


def _nice_step(least: float) -> float:
    """The smallest of 1, 2, 2.5, 5 times a power of ten that is not below `least`."""
    if least < 1e-300:
        return 1e-300
    power = 10.0 ** math.floor(math.log10(least))
    return next(m * power for m in (1, 2, 2.5, 5, 10) if m * power >= least * (1 - 1e-9))
