"""What a glossmeter would read: specular gloss at 20, 60 and 85 degrees, and reflection haze.

Gloss units: 100 x flux from the specimen / flux from polished black glass of n = 1.567, both through the same
apertures. Standards: ISO 2813:2014 and ASTM D523 (gloss), ASTM D4039 (haze index, G60 - G20), ASTM E430 method B and
ISO 13803 (haze beside the 20 degree image). The aperture sizes below are the standards' nominal ones; they are
parameters, as instruments have their own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.analysis.gloss.luminance import luminance_weights
from brdfcore.analysis.gloss.receptor import Rectangle, received, rectangle_nodes
from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import shown
from brdfcore.base.quadrature import gauss_legendre
from brdfcore.models.base.fresnel import dielectric

Float64Array = npt.NDArray[np.float64]

#: Index of the black glass that has 100 gloss units at every angle (ISO 2813:2014, ASTM D523).
REFERENCE_IOR = 1.567
#: Error, gloss units, at which the integration is content: half of the last digit that instruments show.
TOLERANCE = 0.05
#: Values (evaluations x channels) that one geometry may spend after its first two levels.
BUDGET = 50_000_000
#: Nodes on each panel over azimuth and half vector, and over the source along and across. What a level changes on the
#: one before, times the factor beside it, is taken for its error: coarse levels may agree by chance.
_LEVELS = ((3, 4, 2, 3), (4, 6, 3, 4), (8, 10, 4, 6), (16, 20, 6, 8), (24, 30, 8, 10), (40, 50, 12, 14))
_TRUST = (0, 4, 2, 1, 1, 1)


@dataclass(frozen=True, slots=True)
class Geometry:
    """One geometry of a glossmeter, all angles in degrees.

    name      what the result is called.
    theta     polar angle of the source's axis; the receptor's is its mirror image.
    source    (in the plane of incidence, across it) full angles of the source's image; (0, 0) is a collimated source.
    receptor  the same of the receptor.
    offsets   polar angles between the receptor's centre and the mirror direction; more than one: fluxes added.
    """

    name: str
    theta: float
    source: tuple[float, float] = (0.75, 2.5)
    receptor: tuple[float, float] = (1.8, 3.6)
    offsets: tuple[float, ...] = (0.0,)

    def __post_init__(self) -> None:
        for name, values, low, high in (
            ("theta", (self.theta,), 0.0, 90.0),
            ("source", self.source, 0.0, 60.0),
            ("receptor", self.receptor, 1e-3, 60.0),  # a smaller one receives nothing that could be compared
            ("offsets", self.offsets, -60.0, 60.0),
        ):
            count = {"theta": 1, "source": 2, "receptor": 2}.get(name)
            good = isinstance(values, (tuple, list)) and (len(values) == count if count else 0 < len(values) <= 8)
            if not good or not all(_is_number(v) and low <= v <= high for v in values):
                listed = f"{count} number(s)" if count else "1 to 8 numbers"
                raise InputError(
                    "bad_geometry",
                    f"geometry {self.name!r}: {name} = {shown(values)}: expected {listed} from {low:g} to {high:g} "
                    "degrees",
                    where=name,
                    got=shown(values),
                    expected=f"{listed} in [{low:g}, {high:g}]",
                )
        if self.theta + 0.5 * self.source[0] >= 90:
            raise InputError(
                "bad_geometry",
                f"geometry {self.name!r}: the source reaches {self.theta + 0.5 * self.source[0]:g} degrees; "
                "it must stay above the horizon",
                where="theta",
                got=self.theta,
                expected="theta + source/2 < 90",
            )


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool) and math.isfinite(value)


#: ISO 2813:2014 table 1 and ASTM D523 table 1.
GLOSS = (
    Geometry("20", 20.0, receptor=(1.8, 3.6)),
    Geometry("60", 60.0, receptor=(4.4, 11.7)),
    Geometry("85", 85.0, receptor=(4.0, 6.0)),
)
#: ASTM E430 method B, ISO 13803: two receptors, centred 1.9 degrees to either side of the 20 degree mirror direction.
#: From memory, as is the width across: no source was at hand. Consistent with 17.2 to 19.0 and 21.0 to 22.8 degrees.
HAZE = Geometry("haze 20", 20.0, receptor=(1.8, 5.5), offsets=(-1.9, 1.9))


@dataclass(frozen=True)
class Reading:
    """What one geometry reads.

    values     gloss units of each channel; `of_delta` is the part of them that the perfect mirror part gives.
    error      estimated error of the integration, gloss units, of each channel.
    luminance  gloss units of the luminance (`Gloss.luminance_of`), None where there is none.
    reference  reflectance of the black glass, averaged over the source's image.
    evaluations, converged   what it took, and whether `error` is within the tolerance.
    """

    geometry: Geometry
    values: list[float]
    error: list[float]
    of_delta: list[float]
    luminance: float | None
    luminance_error: float | None
    reference: float
    evaluations: int
    converged: bool

    def to_json(self) -> dict[str, Any]:
        """JSON-ready; angles in degrees, what is not finite becomes null."""
        found = asdict(self)
        for name in ("values", "error", "of_delta"):
            found[name] = [x if math.isfinite(x) else None for x in found[name]]
        for name in ("luminance", "luminance_error"):
            found[name] = found[name] if found[name] is not None and math.isfinite(found[name]) else None
        return found


@dataclass(frozen=True)
class Gloss:
    """Gloss and haze of a material.

    gloss        readings by geometry, "20", "60" and "85" unless others were asked for.
    haze         {"astm_d4039": G60 - G20, "astm_e430": reading beside the 20 degree image}, where they were measured;
                 each {"values", "error", "luminance", "luminance_error"} in gloss units.
    luminance_of what the luminance is of, or why there is none.
    """

    channels: Channels
    gloss: dict[str, Reading]
    haze: dict[str, dict[str, Any]]
    luminance_of: str
    reference_ior: float
    tolerance: float

    @property
    def standards(self) -> list[str]:
        """Those that the readings follow, as far as nothing was changed in their geometries."""
        named = {
            "ISO 2813:2014 / ASTM D523 (gloss)": all(r.geometry in GLOSS for r in self.gloss.values()),
            "ASTM D4039 (haze, G60 - G20)": "astm_d4039" in self.haze,
            "ASTM E430 B / ISO 13803 (haze at 20)": "astm_e430" in self.haze,
        }
        return [name for name, follows in named.items() if follows]

    def to_json(self) -> dict[str, Any]:
        """JSON-ready."""
        return {
            "channels": self.channels.to_json(),
            "unit": "GU",
            "angles": "deg",
            "gloss": {name: r.to_json() for name, r in self.gloss.items()},
            "haze": self.haze,
            "luminance_of": self.luminance_of,
            "reference_ior": self.reference_ior,
            "tolerance": self.tolerance,
            "standards": self.standards,
        }


def gloss(
    b: Brdf,
    *,
    geometries: Sequence[Geometry] = GLOSS,
    haze: Geometry | None = HAZE,
    reference_ior: float = REFERENCE_IOR,
    tolerance: float = TOLERANCE,
    budget: int = BUDGET,
) -> Gloss:
    """Gloss units (20, 60, 85 degrees) and haze of any BRDF, per channel and as a luminance.

    Flux = mean over the source's image of int f_r cos(theta_o) dwo over the receptor, integrated over the half vector
    from the mirror direction of each source point outwards, so that a lobe of any width is resolved; the perfect mirror
    part is added exactly: what of the source's mirror image lies within the receptor. Uniform radiance over the
    source's image is assumed, and a receptor of equal response.

    tolerance  gloss units; nodes are added until that changes the reading by less.
    budget     values (evaluations x channels) at which one geometry ends, with the error it has reached; two levels,
               about a hundred thousand evaluations, are always made.
    haze       a geometry relative to the gloss flux of the glass at the same angle; None leaves it out.

    Raises `InputError` for a geometry, tolerance, budget or index that cannot be.

    >>> found = bc.gloss(bc.model("mirror", ior=1.5168))  # 100 F(1.5168)/F(1.567), the standards' glass
    >>> [round(reading.luminance, 2) for reading in found.gloss.values()]
    [86.47, 91.91, 99.27]
    """
    _check_options(reference_ior, tolerance, budget)
    named = [g.name for g in (*geometries, *([haze] if haze else []))]
    if len(set(named)) < len(named) or not geometries:
        raise InputError(
            "bad_geometry", f"geometries: expected at least one, each name once; got {shown(named)}", where="geometries"
        )
    weights, luminance_of = luminance_weights(b.channels)
    readings = {g.name: _read(b, g, g, weights, reference_ior, tolerance, budget) for g in geometries}
    found: dict[str, dict[str, Any]] = {}
    if all(name in readings and readings[name].geometry.theta == float(name) for name in ("20", "60")):
        found["astm_d4039"] = _difference(readings["60"], readings["20"])
    if haze is not None:
        specular = next((g for g in geometries if g.theta == haze.theta), None)
        if specular is not None:
            found["astm_e430"] = _read(b, haze, specular, weights, reference_ior, tolerance, budget).to_json()
    return Gloss(b.channels, readings, found, luminance_of, float(reference_ior), float(tolerance))


def _check_options(reference_ior: Any, tolerance: Any, budget: Any) -> None:
    whole = isinstance(budget, (int, np.integer)) and not isinstance(budget, bool)
    for name, value, good, expected in (
        ("reference_ior", reference_ior, _is_number(reference_ior) and 1 < reference_ior <= 10, "a number in (1, 10]"),
        ("tolerance", tolerance, _is_number(tolerance) and tolerance > 0, "a finite number > 0 of gloss units"),
        ("budget", budget, whole and 1 <= budget <= 10**10, "a whole number from 1 to 1e10"),
    ):
        if not good:
            raise InputError(
                "bad_option", f"{name} = {shown(value)}: expected {expected}", where=name, got=shown(value)
            )


def _difference(a: Reading, b: Reading) -> dict[str, Any]:
    """a - b with both errors."""
    known = None not in (a.luminance, b.luminance)
    found: dict[str, Any] = {
        "values": [x - y for x, y in zip(a.values, b.values)],
        "error": [x + y for x, y in zip(a.error, b.error)],
        "luminance": (a.luminance or 0) - (b.luminance or 0) if known else None,
        "luminance_error": (a.luminance_error or 0) + (b.luminance_error or 0) if known else None,
    }
    return {
        k: [x if math.isfinite(x) else None for x in v] if isinstance(v, list) else v if v is None or math.isfinite(v)
        else None for k, v in found.items()
    }  # fmt: skip


def _read(
    b: Brdf,
    geometry: Geometry,
    specular: Geometry,
    weights: Float64Array | None,
    ior: float,
    tolerance: float,
    budget: int,
) -> Reading:
    """The reading of `geometry`, relative to the glass seen through `specular`."""
    glass = _mirrored(specular, lambda theta: dielectric(np.cos(theta), ior)[:, None])[0]
    if not glass > 0:
        raise InputError(
            "bad_geometry",
            f"geometry {specular.name!r}: the receptor sees nothing of the source's mirror image",
            where="receptor",
        )
    scale = 100 / glass
    nothing = np.zeros(len(b.channels))
    delta = scale * _mirrored(geometry, b.delta_reflectance) if b.has_delta else nothing
    spent, before, error = 0, None, np.full(len(b.channels), np.inf)
    regular = last = nothing
    for level, following, trust in zip(_LEVELS, (*_LEVELS[1:], None), _TRUST):
        regular, used = _regular(b, geometry, level)
        regular *= scale
        spent += used
        if before is not None:
            change = np.abs(regular - before)
            error = np.maximum(trust * change, last / 8)  # a small change after a large one may be luck
            last = change
            # a value that is not finite does not become finite
            if not (error > tolerance).any() or not np.isfinite(regular).all():
                break
            after = spent if following is None else spent + used * math.prod(following) / math.prod(level)
            if after * len(b.channels) > budget:
                break
        before = regular
    values = regular + delta
    return Reading(
        geometry,
        values.tolist(),
        error.tolist(),
        delta.tolist(),
        None if weights is None else float(weights @ values),
        None if weights is None else float(weights @ error),
        float(glass),
        spent,
        bool((error <= tolerance).all()),
    )


def _regular(b: Brdf, geometry: Geometry, level: tuple[int, int, int, int]) -> tuple[Float64Array, int]:
    """(mean over the source of the flux into the receptors, (channels,); evaluations), the delta part left out."""
    n_phi, n_rho, n_along, n_across = level
    theta = math.radians(geometry.theta)
    wide, high = (math.radians(a) for a in geometry.source)
    x, y, weight = rectangle_nodes(wide, high, n_along, n_across, half=b.bilateral)
    towards = np.array([math.sin(theta), 0.0, math.cos(theta)])
    along, across = np.array([math.cos(theta), 0.0, -math.sin(theta)]), np.array([0.0, 1.0, 0.0])
    lights = towards + x[:, None] * along + y[:, None] * across
    lights /= np.linalg.norm(lights, axis=1)[:, None]
    total, spent = np.zeros(len(b.channels)), 0
    for offset in geometry.offsets:
        aperture = Rectangle(theta + math.radians(offset), *map(math.radians, geometry.receptor))
        for light, share in zip(lights, weight):
            flux, used = received(b, light, aperture, n_phi, n_rho)
            total += share * flux
            spent += used
    return total, spent


def _mirrored(geometry: Geometry, reflectance: Any) -> Float64Array:
    """Flux of a perfect mirror's image of the source within the receptors, as a share of the source's, (channels,).

    In the tangent plane of the mirror direction a receptor turned by an offset ends at x = tan(offset -+ along/2) and
    at |y| = tan(across/2) (cos offset + x sin offset). `reflectance` of theta_i gives (n, channels).
    """
    theta = math.radians(geometry.theta)
    ends = [math.tan(0.5 * math.radians(a)) for a in geometry.source]
    a, b = (0.5 * math.radians(v) for v in geometry.receptor)
    total: Float64Array = np.zeros(1)
    for offset in (math.radians(o) for o in geometry.offsets):
        low, high = max(-ends[0], math.tan(offset - a)), min(ends[0], math.tan(offset + a))
        if low > high or (low == high and ends[0] > 0):
            continue
        x, w_x = gauss_legendre(24, low, high) if high > low else (np.zeros(1), np.ones(1))
        widest = math.tan(b) * (math.cos(offset) + x * math.sin(offset))
        share = np.minimum(ends[1], widest) if ends[1] else np.ones_like(x)
        u, w_u = gauss_legendre(24, -1.0, 1.0) if ends[1] else (np.zeros(1), np.ones(1))
        y = share[:, None] * u if ends[1] else np.zeros((x.size, 1))
        weight = w_x[:, None] * share[:, None] * w_u / (1 + x[:, None] ** 2 + y * y) ** 1.5
        c, s = math.cos(theta), math.sin(theta)
        theta_i = np.arctan2(np.hypot(s + x[:, None] * c, y), np.broadcast_to(c - x[:, None] * s, y.shape)).reshape(-1)
        total = total + weight.reshape(-1) @ reflectance(theta_i)
    return np.asarray(total / _solid_angle(ends))


def _solid_angle(ends: Sequence[float]) -> float:
    """Of the source's image; a side of no width counts as 1, as its single node does."""
    nodes = [gauss_legendre(24, -e, e) if e else (np.zeros(1), np.ones(1)) for e in ends]
    (x, w_x), (y, w_y) = nodes
    return float((np.outer(w_x, w_y) / (1 + x[:, None] ** 2 + y * y) ** 1.5).sum())
