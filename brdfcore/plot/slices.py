"""The numbers behind a picture: f_r in the plane of incidence, or over the hemisphere of viewers.

Plane of incidence: the viewer's angle is signed, theta_o in [-pi/2, pi/2]. Positive is the mirror side
(delta_phi = pi), negative the side of the light (delta_phi = 0), so that the mirror direction is
theta_o = +theta_i and the light itself stands at theta_o = -theta_i.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base import conventions
from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.errors import InputError
from brdfcore.names import AngleUnit, View, choices

Array = npt.NDArray[np.float64]

#: Evenly spaced directions of a slice, both horizons included: every half degree.
POLAR_POINTS = 361
#: Nodes over theta_o of a hemisphere; delta_phi has four times as many intervals (a whole turn).
HEMISPHERE_POINTS = 91
POINTS_MAX = {"polar": 100_001, "hemisphere": 1_001}
#: Distances to the mirror direction of the added nodes, radians, in geometric progression: a lobe has about
#: the same number of nodes across it whatever its roughness, from 1e-6 upwards.
_NEAREST, _FARTHEST, _RATIO = 1e-6, 0.3, 1.15
#: Nodes are multiples of 1e-9 degrees and printed degrees are rounded to 1e-12, so that an angle read back
#: from a file of degrees is the angle that was evaluated, not its neighbour.
_NODE_DECIMALS, _PRINT_DECIMALS = 9, 12


@dataclass(frozen=True)
class SliceData:
    """f_r on a slice, 1/sr, without the cosine and without the delta part.

    view       "polar" or "hemisphere".
    theta_i    (k,), radians; k = 1 for "hemisphere".
    theta_o    "polar": (k, m), signed, ascending, from -pi/2 to pi/2. "hemisphere": (n,), from 0 to pi/2.
    delta_phi  "polar": (k, m), pi where theta_o >= 0, else 0. "hemisphere": (m,), from 0 to 2 pi, both included.
    values     "polar": (k, m, channels). "hemisphere": (n, m, channels).
    channels   what the last axis of `values` means.
    """

    view: View
    theta_i: Array
    theta_o: Array
    delta_phi: Array
    values: Array
    channels: Channels

    def to_json(self, angles: AngleUnit = "deg") -> dict[str, Any]:
        """JSON-ready: the fields as nested lists, with `unit` ("1/sr") and `angles`; a value not finite is null."""
        convert = _converter(angles)
        values = self.values.tolist()
        if not np.isfinite(self.values).all():
            values = [
                [[x if np.isfinite(x) else None for x in channel_values] for channel_values in row] for row in values
            ]
        return {
            "view": self.view,
            "angles": angles,
            "unit": "1/sr",
            "channels": self.channels.to_json(),
            "theta_i": convert(self.theta_i).tolist(),
            "theta_o": convert(self.theta_o).tolist(),
            "delta_phi": convert(self.delta_phi).tolist(),
            "values": values,
        }

    def to_csv(self, angles: AngleUnit = "deg") -> str:
        """One line a direction: theta_i, theta_o, delta_phi, [theta_o_signed,] one column a channel.

        Lines starting with # say what the columns are. The first three angles are those `Brdf.evaluate` takes;
        theta_o_signed ("polar" only) is the plot's axis. Values have all their digits (`repr` of the float64).
        """
        convert = _converter(angles)
        polar = self.view == "polar"
        signed: Array | None = None
        if polar:
            theta_i = np.broadcast_to(self.theta_i[:, None], self.theta_o.shape)
            theta_o, delta_phi, signed = np.abs(self.theta_o), self.delta_phi, self.theta_o
        else:
            theta_o, delta_phi = (x.copy() for x in np.meshgrid(self.theta_o, self.delta_phi, indexing="ij"))
            theta_i = np.broadcast_to(self.theta_i[0], theta_o.shape)
        columns = [convert(x).ravel() for x in (theta_i, theta_o, delta_phi)]
        names = [f"{n}_{angles}" for n in conventions.ANGLE_NAMES]
        if signed is not None:
            columns.append(convert(signed).ravel())
            names.append(f"theta_o_signed_{angles}")
        labels = [str(c) if self.channels.kind == "name" else f"{c:g}nm" for c in self.channels]
        table = np.column_stack([*columns, self.values.reshape(-1, len(self.channels))])
        lines = [
            f"# f_r in 1/sr, without the cosine; angles in {'degrees' if angles == 'deg' else 'radians'}",
            "# the mirror direction is theta_o = theta_i, delta_phi = 180 degrees",
            *(["# theta_o_signed is positive at delta_phi = 180 degrees (mirror side)"] if polar else []),
            ",".join([*names, *(_csv_field(f"f_r_{x}") for x in labels)]),
        ]
        lines += [",".join(map(repr, row)) for row in table.tolist()]
        return "\n".join(lines) + "\n"


def slice(
    b: Brdf,
    theta_i: npt.ArrayLike,
    *,
    view: View = "polar",
    channel: str | float | None = None,
    points: int | None = None,
) -> SliceData:
    """f_r of `b` in the plane of incidence ("polar") or over the hemisphere of viewers ("hemisphere").

    theta_i  polar angle(s) of the light, radians, [0, pi/2]; exactly one for "hemisphere".
    channel  name, wavelength or position of one channel; None keeps all.
    points   evenly spaced directions: over theta_o in [-pi/2, pi/2] (default 361) for "polar", over theta_o in
             [0, pi/2] (default 91) for "hemisphere". Nodes near the mirror direction come on top, down to
             1e-6 rad from it, so that the peak of a sharp lobe is its true value.

    Raises `InputError` for an angle outside its domain or a bad view or number of points, `UnknownNameError`
    for an unknown channel.

    >>> data = bc.slice(bc.model("lambert", reflectance=0.5), np.radians([0.0, 30.0]))
    >>> data.values.shape[0], float(data.values.max().round(6))
    (2, 0.159155)
    """
    if view not in choices(View):
        raise InputError(
            "bad_option",
            f"view={view!r}: expected 'polar' or 'hemisphere'",
            where="view",
            got=str(view)[:40],
            expected="'polar' or 'hemisphere'",
        )
    angles = conventions.check_domain(conventions.flatten_angles(theta_i, 0.0, 0.0))
    lights = np.minimum(angles.theta_i.astype(np.float64), conventions.HALF_PI)
    if lights.size == 0 or (view == "hemisphere" and lights.size != 1):
        expected = "one angle" if view == "hemisphere" else "at least one angle"
        raise InputError(
            "wrong_number",
            f"theta_i: the {view} view takes {expected}, got {lights.size}",
            where="theta_i",
            got=int(lights.size),
            expected=expected,
        )
    default = POLAR_POINTS if view == "polar" else HEMISPHERE_POINTS
    points = default if points is None else points
    if isinstance(points, bool) or not isinstance(points, (int, np.integer)) or not 3 <= points <= POINTS_MAX[view]:
        raise InputError(
            "bad_points",
            f"points = {points!r}: expected a whole number from 3 to {POINTS_MAX[view]}",
            where="points",
            got=str(points)[:40],
            expected=f"3 to {POINTS_MAX[view]}",
        )
    pick = None if channel is None else b.channels.find(channel)
    channels = b.channels if pick is None else Channels([b.channels[pick]], b.channels.kind)
    kept = np.s_[..., :] if pick is None else np.s_[..., pick : pick + 1]

    if view == "polar":
        theta_o = np.stack([_signed_nodes(float(t), int(points)) for t in lights])
        delta_phi = np.where(theta_o >= 0, np.pi, 0.0)
        values = b.evaluate(lights[:, None], np.abs(theta_o), delta_phi)[kept]
        return SliceData("polar", lights, theta_o, delta_phi, np.ascontiguousarray(values), channels)
    theta_o, delta_phi = _hemisphere_nodes(float(lights[0]), int(points))
    if b.bilateral:
        half = delta_phi.size // 2 + 1  # the nodes are symmetric about pi
        values = b.evaluate(lights[0], theta_o[:, None], delta_phi[None, :half])[kept]
        values = np.concatenate([values, values[:, -2::-1]], axis=1)
    else:
        values = b.evaluate(lights[0], theta_o[:, None], delta_phi[None, :])[kept]
    return SliceData("hemisphere", lights, theta_o, delta_phi, np.ascontiguousarray(values), channels)


def _offsets_deg(nearest: float) -> Array:
    """Distances of the added nodes to the mirror direction, degrees, from `nearest` (radians) up."""
    count = int(np.ceil(np.log(_FARTHEST / nearest) / np.log(_RATIO)))
    return np.degrees(np.geomspace(nearest, _FARTHEST, count))


def _with_peak(even_deg: Array, peak: float, nearest: float) -> Array:
    """Even nodes and those graded towards `peak` (radians), in radians; the count does not depend on `peak`.

    What would lie beyond the ends halves the widest gaps instead, so that slices of several theta_i stack.
    """
    offsets = _offsets_deg(nearest)
    count = even_deg.size + 2 * offsets.size + 1
    centre = round(float(np.degrees(peak)), _NODE_DECIMALS)
    nodes = np.concatenate([even_deg, [centre], centre - offsets, centre + offsets])
    nodes = np.unique(np.round(nodes[(nodes >= even_deg[0]) & (nodes <= even_deg[-1])], _NODE_DECIMALS))
    while (missing := count - nodes.size) > 0:
        gaps = np.diff(nodes)
        widest = np.argsort(-gaps, kind="stable")[:missing]
        middles = np.round(nodes[widest] + gaps[widest] / 2, _NODE_DECIMALS)
        nodes = np.unique(np.concatenate([nodes, middles]))
    radians = np.asarray(np.radians(nodes))
    radians[int(np.argmin(np.abs(nodes - centre)))] = peak  # exact also where it is no multiple of 1e-9 degrees
    return radians


def _signed_nodes(theta_i: float, points: int) -> Array:
    """Signed theta_o of one slice, ascending, -pi/2, 0 and pi/2 included."""
    even = np.linspace(-90.0, 90.0, points + 1 - points % 2)  # an odd number: 0 is one of them
    return _with_peak(even, theta_i, _NEAREST)


def _hemisphere_nodes(theta_i: float, points: int) -> tuple[Array, Array]:
    """theta_o in [0, pi/2] and delta_phi in [0, 2 pi]; the latter symmetric about pi, graded towards it."""
    # coarser at the peak than the slice: pixels are about 6e-3 rad wide, and the peak itself is a node
    theta_o = _with_peak(np.linspace(0.0, 90.0, points), theta_i, 3e-4)
    half = _with_peak(np.linspace(0.0, 180.0, 2 * points - 1), np.pi, 3e-4)
    return theta_o, np.concatenate([half, 2 * np.pi - half[-2::-1]])


def _converter(angles: str) -> Any:
    if angles == "rad":
        return lambda x: x
    if angles == "deg":
        return lambda x: np.round(np.degrees(x), _PRINT_DECIMALS) + 0.0  # + 0.0: no "-0.0"
    raise InputError(
        "bad_option",
        f"angles={angles!r}: expected 'deg' or 'rad'",
        where="angles",
        got=str(angles)[:40],
        expected="'deg' or 'rad'",
    )


def _csv_field(text: str) -> str:
    """A header field after RFC 4180; a leading =, +, - or @ can't occur, every field begins with f_r_."""
    return '"' + text.replace('"', '""') + '"' if any(c in text for c in ',"\r\n') else text
