"""Look-ups and draws in Dr.Jit, through the tables of `half_difference` and `kernels.base.quantile_warp`."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from brdfcore.kernels.base.quantile_warp import RISE, TIP
from brdfcore.kernels.tables import half_difference as kernels
from brdfcore.sampling.quantiles import QuantileSampler, cell_masses
from brdfcore.tables.base.layout import FACTORS, STEPS_Z
from brdfcore.tables.half_difference import HalfDifference


def _cell(place: Any, last: Any, integer: Any) -> tuple[Any, Any]:
    """Cell of a place on nodes 0 ... last, and the part of the way through it."""
    cell = dr.clip(dr.floor(place), 0, last - 1)
    return integer(cell), dr.clip(place - cell, 0, 1)


def _line(table: Any, at: Any, part: Any, kind: Any) -> Any:
    low = dr.gather(kind, table, at)
    return dr.fma(dr.gather(kind, table, at + 1) - low, part, low)


class HalfDifferenceLookup:
    """f_r of unit vectors above the horizon by a linear `half_difference` table of one or three channels."""

    def __init__(self, mi: Any, table: HalfDifference) -> None:
        self.mi = mi
        arrays = table.to_arrays()
        nodes = arrays["values"].astype(np.float32) / np.float32(table.scale)
        self.channels, self.shape = nodes.shape[3], nodes.shape[:3]
        self.bilateral, self.reciprocal, self.mirror = table.bilateral, table._reciprocal_fold, bool(table.mirror)
        self.factor, self.guide = FACTORS[table.factor], table.guide
        names = ("guide_h", "guide_d", "map_h", "map_d", "map_p")
        self.words = {name: mi.Float(arrays[name].astype(np.float32)) for name in names}
        self.nodes = mi.Float(np.ascontiguousarray(nodes).reshape(-1))
        self.steps_z = STEPS_Z * kernels.SHORT

    def f(self, wi: Any, wo: Any) -> Any:
        """Color3f, 1/sr."""
        mi = self.mi
        h = wi + wo
        across = dr.fma(h.x, h.x, h.y * h.y)
        u = across * dr.square(dr.rcp(h.z))
        w = dr.minimum(0.25 * dr.fma(h.z, h.z, across), 1)
        cross, apart = wi.x * wo.y - wi.y * wo.x, wo.z - wi.z
        if self.mirror:
            u = 0.25 * dr.fma(apart, apart, across)
        along, up = apart * dr.sqrt(w), dr.abs(cross)
        both = dr.abs(along) + up
        z = dr.select(both > 0, up / dr.select(both > 0, both, 1), 1)
        if not self.reciprocal:
            z = dr.select(along < 0, 2 - z, z)
        if not self.bilateral:
            z = dr.select(cross < 0, -z, z) + 2
        k = self.factor
        strength = (k[0] * wi.z + k[1] * wo.z + k[2]) / (k[3] * wi.z * wo.z + k[4] * (wi.z + wo.z) + k[5])
        i, at_h, guide_h = self._mapped(u, "h", kernels._U_FIRST, kernels._U_LAST, kernels._U_SHIFT, self.shape[0])
        j, at_d, guide_d = self._mapped(w, "d", kernels._W_FIRST, kernels._W_LAST, kernels._W_SHIFT, self.shape[1])
        n_p = self.shape[2]
        step, beyond = _cell(z * self.steps_z, dr.width(self.words["map_p"]) - 1, mi.UInt32)
        place = _line(self.words["map_p"], step, beyond, mi.Float) * ((n_p - 1) / kernels.WORDS)
        l, at_p = _cell(place, n_p - 1, mi.UInt32)  # noqa: E741
        exponent = (guide_h + guide_d) * self.guide[1] + self.guide[0]
        node = (i * self.shape[1] + j) * n_p + l
        return mi.Color3f(self._trilinear(node, at_h, at_d, at_p)) * (dr.exp2(exponent) * strength)

    def _mapped(self, x: Any, axis: str, first: int, last: int, shift: int, n: int) -> tuple[Any, Any, Any]:
        """(cell, part, guide's number) of a coordinate whose map is uniform in the bits of a float32."""
        mi = self.mi
        whole: Any = dr.reinterpret_array(mi.Int32, x)
        bits = dr.clip(whole - first, 0, last - 1)
        step: Any = mi.UInt32(bits >> shift)
        part: Any = mi.Float(bits & ((1 << shift) - 1)) * 2.0**-shift
        place = _line(self.words[f"map_{axis}"], step, part, mi.Float) * ((n - 1) / kernels.WORDS)
        cell, beyond = _cell(place, n - 1, mi.UInt32)
        return cell, beyond, _line(self.words[f"guide_{axis}"], step, part, mi.Float)

    def _trilinear(self, node: Any, at_h: Any, at_d: Any, at_p: Any) -> Any:
        kind = self.mi.Color3f if self.channels == 3 else self.mi.Float
        row, plane = self.shape[2], self.shape[1] * self.shape[2]

        def line(at: Any) -> Any:
            low, high = (dr.gather(kind, self.nodes, at + step) for step in (0, 1))
            return dr.fma(high - low, at_p, low)

        def face(at: Any) -> Any:
            low, high = line(at), line(at + row)
            return dr.fma(high - low, at_d, low)

        low, high = face(node), face(node + plane)
        return dr.fma(high - low, at_h, low)


class QuantileDraw:
    """Draws and densities of `kernels.base.quantile_warp`."""

    def __init__(self, mi: Any, made: QuantileSampler) -> None:
        self.mi = mi
        self.k, self.m, self.n = made.polar.shape[0], made.polar.shape[1] - 1, made.polar.shape[2] - 3
        self.azimuth, self.polar = mi.Float(made.azimuth.reshape(-1)), mi.Float(made.polar.reshape(-1))
        self.mass = mi.Float(cell_masses())

    def draw(self, wi: Any, u: Any) -> tuple[Any, Any]:
        """(wo, density, 1/sr) for unit wi above the horizon and u in [0, 1)."""
        mi = self.mi
        c, s, cos_p, sin_p, k, w = self._frame(wi)
        signed = 2 * u.y - 1
        root = dr.sqrt(dr.maximum(1 - dr.abs(signed), 0))
        i, at_v = _cell((0.5 + 0.5 * dr.select(signed < 0, -1, 1) * (1 - root)) * self.m, self.m, mi.UInt32)
        inner, outer = dr.sqrt(TIP * TIP + 4 * RISE * u.x), dr.sqrt(dr.maximum((1 - u.x) * (TIP + RISE), 0))
        near = u.x < 0.5 * TIP + 0.25 * RISE
        x = dr.select(near, 2 * u.x / (TIP + inner), 1 - outer / (TIP + RISE))
        j, part = _cell(x * self.n, self.n, mi.UInt32)
        phi_0, phi_1 = self._azimuths(k, w, i)
        nodes = self._zetas(k, w, i, at_v, j)
        upward, ratio, whole = self._grading(nodes, j)
        at = dr.select(upward, part, 1 - part)
        t = 1 + at * (ratio - 1) / whole
        t2, t4, t8 = _powers(t)
        share = at * (t + 1) * (t2 + 1) * (t4 + 1) * (t8 + 1) / whole
        width = nodes[2] - nodes[1]
        zeta = dr.maximum(nodes[1] + width * dr.select(upward, share, 1 - share), 0)
        phi = phi_0 + (phi_1 - phi_0) * at_v
        sin_phi, cos_phi = dr.sincos(phi)
        edge = _horizon(c, s, cos_phi)
        half = zeta * edge
        cos_h, sin_h = 1 - 2 * half, 2 * dr.sqrt(dr.maximum(half * (1 - half), 0))
        dot = s * sin_h * cos_phi + c * cos_h
        a, b = 2 * dot * sin_h * cos_phi - s, 2 * dot * sin_h * sin_phi
        up = c * (1 - 2 * sin_h * sin_h) + 2 * s * sin_h * cos_h * cos_phi
        wo = mi.Vector3f(a * cos_p - b * sin_p, a * sin_p + b * cos_p, up)
        area = (phi_1 - phi_0) * self.m * width * self.n * (16 * t8 * t4 * t2 * t / whole)
        slopes = dr.select(near, inner, 2 * outer) * 2 * root
        return wo, slopes / (area * 8 * edge * dot)

    def density(self, wi: Any, wo: Any) -> Any:
        """1/sr, of unit vectors above the horizon."""
        c, s, cos_p, sin_p, k, w = self._frame(wi)
        x, y, z = wo.x * cos_p + wo.y * sin_p + s, wo.y * cos_p - wo.x * sin_p, wo.z + c
        tan2 = (x * x + y * y) / (z * z)
        secant = dr.sqrt(1 + tan2)
        across = dr.sqrt(x * x + y * y)
        cos_phi = dr.select(across > 0, x / dr.select(across > 0, across, 1), 1)
        edge = _horizon(c, s, cos_phi)
        phi, zeta = dr.atan2(y, x), 0.5 * tan2 / (secant * (1 + secant)) / edge
        i = self._found(self.m, lambda at: self._azimuths(k, w, at)[0] <= phi)
        phi_0, phi_1 = self._azimuths(k, w, i)
        at_v = dr.clip((phi - phi_0) / (phi_1 - phi_0), 0, 1)
        j = self._found(self.n, lambda at: self._zeta(k, w, i, at_v, at + 1) <= zeta)
        nodes = self._zetas(k, w, i, at_v, j)
        upward, ratio, whole = self._grading(nodes, j)
        width = nodes[2] - nodes[1]
        share = dr.clip((zeta - nodes[1]) / width, 0, 1)
        share = dr.select(upward, share, 1 - share)
        t8 = dr.sqrt(1 + share * (ratio - 1))
        t4 = dr.sqrt(t8)
        t2 = dr.sqrt(t4)
        t = dr.sqrt(t2)
        part = share * whole / ((t + 1) * (t2 + 1) * (t4 + 1) * (t8 + 1))
        at = dr.minimum((self.mi.Float(j) + dr.select(upward, part, 1 - part)) / self.n, 1)
        v = dr.minimum(dr.abs(2 * (self.mi.Float(i) + at_v) / self.m - 1), 1)
        slope = dr.select(at < 0.5, TIP + 2 * RISE * at, 2 * (TIP + RISE) * (1 - at))
        area = (phi_1 - phi_0) * self.m * width * self.n * (16 * t8 * t4 * t2 * t / whole)
        return slope * 2 * (1 - v) / (area * 8 * edge * 0.5 * z * secant)

    def _frame(self, wi: Any) -> tuple[Any, ...]:
        """cos, sin of theta_i, cos, sin of its azimuth, slice and weight of the next."""
        across = dr.sqrt(wi.x * wi.x + wi.y * wi.y)
        turned = across > 0
        inverse = dr.rcp(dr.select(turned, across, 1))
        c = dr.maximum(wi.z, 1e-7)
        place = (1 - dr.sqrt(c / dr.sqrt(1 + across))) * (self.k - 1)
        k, w = _cell(place, self.k - 1, self.mi.UInt32)
        return c, across, dr.select(turned, wi.x * inverse, 1), dr.select(turned, wi.y * inverse, 0), k, w

    def _azimuths(self, k: Any, w: Any, i: Any) -> tuple[Any, Any]:
        p = k * (self.m + 1) + i
        found = []
        for step in (0, 1):
            low, high = (dr.gather(self.mi.Float, self.azimuth, p + a + step) for a in (0, self.m + 1))
            found.append(low + (high - low) * w)
        return found[0], found[1]

    def _zeta(self, k: Any, w: Any, i: Any, at_v: Any, column: Any) -> Any:
        """zeta at a column of the padded rows."""
        across, rows = self.n + 3, self.m + 1
        p = (k * rows + i) * across + column
        a, b, c, d = (
            dr.gather(self.mi.Float, self.polar, p + step) for step in (0, across, rows * across, (rows + 1) * across)
        )
        low, high = a + (b - a) * at_v, c + (d - c) * at_v
        return low + (high - low) * w

    def _zetas(self, k: Any, w: Any, i: Any, at_v: Any, j: Any) -> list[Any]:
        return [self._zeta(k, w, i, at_v, j + step) for step in range(4)]

    def _grading(self, nodes: list[Any], j: Any) -> tuple[Any, Any, Any]:
        mass = [dr.gather(self.mi.Float, self.mass, j + step) for step in range(3)]
        width = nodes[2] - nodes[1]
        left, right = (nodes[1] - nodes[0]) * mass[1] / mass[0], (nodes[3] - nodes[2]) * mass[1] / mass[2]
        least = dr.maximum(dr.minimum(left, right), width * 1e-9)
        ratio = dr.maximum(2 * width / least - 1, 1)
        r8 = dr.sqrt(ratio)
        r4 = dr.sqrt(r8)
        r2 = dr.sqrt(r4)
        return left <= right, ratio, (dr.sqrt(r2) + 1) * (r2 + 1) * (r4 + 1) * (r8 + 1)

    def _found(self, last: int, before: Any) -> Any:
        """The last cell of `last` whose first node `before` holds for, by halving."""
        integer = self.mi.UInt32
        low, high = integer(0), integer(last)
        for _ in range(int(last).bit_length()):
            middle = (low + high) >> 1
            below = before(middle)
            open_ = high - low > 1
            low = dr.select(open_ & below, middle, low)
            high = dr.select(open_ & ~below, middle, high)
        return low


def _powers(t: Any) -> tuple[Any, Any, Any]:
    t2 = t * t
    t4 = t2 * t2
    return t2, t4, t4 * t4


def _horizon(c: Any, s: Any, cos_phi: Any) -> Any:
    b = -s * cos_phi
    rho = dr.sqrt(c * c + b * b)
    near = c * c / (rho + dr.abs(b))
    minus, plus = dr.select(b > 0, near, rho - b), dr.select(b > 0, rho + b, near)
    return 0.25 * minus / rho / (1 + dr.sqrt(0.5 * plus / rho))
