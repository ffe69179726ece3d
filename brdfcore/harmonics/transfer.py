"""Light reflected by an expansion: radiance towards any view of a surface with any normal, at once for many.

In the frame of the normal, with the view at phi = 0,

    c_o^p L_o = sum_lm k_lm(theta_o) c'_lm,   k_lm = e_m sum_l'' T^m_ll'' p_l''^m(c_o),   T^m = H^m rho^m
    H^m_ll' = 2 pi int_0^1 x^(1-q) p_l^m p_l'^m dx,   e_0 = 1, e_m = sqrt(2)

c' are the light's coefficients in that frame, q and p how many cosines the target has (`harmonics.targets`): rho's
functions are extended over the horizon, so the upper half of the light counts alone, and H couples odd l with even l'.
What is exact: this sum is the integral of the truncated light times the truncated f c_i over the hemisphere.

With R = R_z(alpha) R_y(beta) R_z(gamma) and R_y = J R_z J (`harmonics.rotation`) half of the rotation is done to the
light, where it is a product of a fixed matrix with cos m alpha and sin m alpha, and half to k:

    sum k c' = sum_u cos(u beta) (b_u a_u + b_-u a_-u) + sin(u beta) (b_-u a_u - b_u a_-u)

a = J D_z(-alpha) c, b = J D_z(gamma) k: products of matrices of some degrees times some hundred normals.
"""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import Channels
from brdfcore.base.conventions import Vectors, flatten_vectors
from brdfcore.base.errors import InputError
from brdfcore.base.quadrature import gauss_legendre
from brdfcore.harmonics.expansion import HarmonicExpansion, expanded
from brdfcore.harmonics.legendre import checked_degree, degrees, legendre
from brdfcore.harmonics.light import Light
from brdfcore.harmonics.rotation import MAX_ROTATED, orders_of, swaps
from brdfcore.harmonics.targets import TARGETS
from brdfcore.kernels.machine.blas import one_blas_thread
from brdfcore.kernels.machine.launch import threads
from brdfcore.tables.base.table import Progress

Float64Array = npt.NDArray[np.float64]

#: Bytes of k of the normals that are done together.
_BYTES = 4_000_000


@dataclass(frozen=True, eq=False)
class Transfer:
    """What lights an expansion, degree by degree: made once for an expansion and a degree of lights."""

    expansion: HarmonicExpansion
    lmax: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "lmax", checked_degree(self.lmax, MAX_ROTATED))

    def radiance(
        self, light: Light, normals: npt.ArrayLike, views: npt.ArrayLike, progress: Progress | None = None
    ) -> Float64Array:
        """L_o towards `views` (..., 3) from surfaces with `normals` (..., 3), which broadcast; (..., channels).

        light    its environment to degree `lmax`; directional lights by the expansion's own f_r. The mirror part
                 reflects the environment, as its coefficients say, and no directional light: that would be a delta.
        Exactly 0 where the view is below the surface. Near the horizon of the view the quotient by c_o makes errors of
        the target larger: the target's norm holds for c_o L_o.
        """
        given = flatten_pairs(normals, views)
        found = self.environment(light, given.wi, given.wo, progress)
        found += directly(self.expansion, light, given.wi, given.wo)
        return found.reshape(*given.shape, -1)

    def environment(
        self, light: Light, normal: Float64Array, view: Float64Array, progress: Progress | None = None
    ) -> Float64Array:
        """What the regular part makes of the environment alone; unit (n, 3) normals and views."""
        light = light if light.lmax <= self.lmax else light.truncated(self.lmax)
        found = np.zeros((len(normal), len(Channels.common(self.expansion.channels, light.channels))))
        if not light.coefficients.any():
            return found
        seen = np.flatnonzero((normal * view).sum(axis=1) > 0)
        step = int(np.clip(_BYTES // (8 * self._size * len(self.expansion.channels)), 16, 1_024))
        matrices = _light_matrices(light)
        self._orders  # noqa: B018  (made once, before threads ask for it)
        parts = [seen[k : k + step] for k in range(0, len(seen), step)]

        def reflect(part: npt.NDArray[np.int64]) -> None:
            found[part] = self._reflected(matrices, light, normal[part], view[part])

        # parts beside each other, each with the plain product: BLAS's own threads wait for each other
        with one_blas_thread(), ThreadPoolExecutor(threads()) as pool:
            for done, _ in enumerate(pool.map(reflect, parts), 1):
                if progress is not None:
                    progress(done, len(parts), "relighting")
        return found

    @property
    def _size(self) -> int:
        return (self.lmax + 1) * (self.lmax + 2) // 2

    @cached_property
    def _orders(self) -> list[tuple[Float64Array, Float64Array | None]]:
        """Of each order e_m T^m of cosines, and of sines: (channels, degrees l of the light, degrees l'' of rho)."""
        e, target = self.expansion, TARGETS[self.expansion.target]
        x, w = gauss_legendre((e.lmax + self.lmax) // 2 + 2)
        found: list[tuple[Float64Array, Float64Array | None]] = []
        for m in range(min(self.lmax + 1, e.orders)):
            p = legendre(self.lmax, x, first_order=m, last_order=m)
            q = legendre(e.lmax, x, parity=target.parity_i, first_order=m, last_order=m)
            h = 2 * np.pi * (p * (w * x ** (1 - target.cos_i))) @ q.T * (np.sqrt(2) if m else 1.0)
            sines = None if e.bilateral or m == 0 else h @ e.coefficients(m, sines=True)
            found.append((h @ e.coefficients(m), sines))
        return found

    def _kernel(self, c_o: Float64Array) -> tuple[Float64Array, Float64Array | None]:
        """k of cosines, and of sines: rows l(l+1)/2 + m, then channels, then normals."""
        e, target = self.expansion, TARGETS[self.expansion.target]
        found = np.zeros((self._size, len(e.channels), c_o.size))
        sines = None if e.bilateral else np.zeros_like(found)
        for m, (cosine, sine) in enumerate(self._orders):
            odd = bool(target.cos_o)
            p = legendre(e.lmax, c_o, parity=target.parity_o, over_x=odd, first_order=m, last_order=m)
            rows = degrees(self.lmax, m)
            place = rows * (rows + 1) // 2 + m
            found[place] = np.moveaxis(cosine @ p, 0, 1)
            if sines is not None and sine is not None:
                # delta_phi = 0 - phi_i
                sines[place] = -np.moveaxis(sine @ p, 0, 1)
        return found, sines

    def _reflected(
        self, matrices: list[_LightMatrices], light: Light, normal: Float64Array, view: Float64Array
    ) -> Float64Array:
        alpha, beta, gamma = _angles(normal, view)
        cosines, sines = self._kernel(_cosine(normal, view))
        m = np.arange(light.lmax + 1)
        waves = _interleaved(m[:, None] * alpha)
        cos_g, sin_g = np.cos(m[:, None, None] * gamma), np.sin(m[:, None, None] * gamma)
        shape = (light.lmax + 1, max(len(light.channels), len(self.expansion.channels)), len(normal))
        along, across = np.zeros(shape), np.zeros(shape)
        for l, (matrix, j) in enumerate(zip(matrices, swaps(_table(light.lmax)))):  # noqa: E741
            part = slice(l * (l + 1) // 2, (l + 1) * (l + 2) // 2)
            k = cosines[part]
            turned = k * cos_g[: l + 1], k * sin_g[: l + 1]
            if sines is not None:
                turned = turned[0] - sines[part] * sin_g[: l + 1], turned[1] + sines[part] * cos_g[: l + 1]
            a_cos, a_sin = matrix.times(waves)
            b_cos, b_sin = np.empty_like(k), np.zeros_like(k)
            even, odd, n = l % 2, 1 - l % 2, k.shape[1] * k.shape[2]
            flat_cos, flat_sin = (t.reshape(l + 1, n) for t in turned)
            # the order 0 of sines is no function
            first = even if even else 2
            b_cos[even::2] = (j.cosines @ flat_cos[even::2]).reshape(-1, *k.shape[1:])
            b_cos[odd::2] = (j.mixed @ flat_sin[first::2]).reshape(-1, *k.shape[1:])
            b_sin[first::2] = (j.mixed.T @ flat_cos[odd::2]).reshape(-1, *k.shape[1:])
            first = odd if odd else 2
            b_sin[first::2] = (j.sines @ flat_sin[first::2]).reshape(-1, *k.shape[1:])
            along[: l + 1] += b_cos * a_cos
            along[: l + 1] += b_sin * a_sin
            across[: l + 1] += b_sin * a_cos
            across[: l + 1] -= b_cos * a_sin
        found = np.einsum("ucn,un->nc", along, np.cos(m[:, None] * beta))
        found += np.einsum("ucn,un->nc", across, np.sin(m[:, None] * beta))
        return np.asarray(found)


def directly(b: Brdf, light: Light, normal: Float64Array, view: Float64Array) -> Float64Array:
    """What directional lights add, sum_k E_k f(w_k, v) max(n.w_k, 0), and the environment in b's mirror part; unit
    (n, 3) normals and views."""
    found = np.zeros((len(normal), max(len(b.channels), len(light.channels))))
    frames = _frames(normal, view)
    local_view = np.einsum("nij,ni->nj", frames, view)
    seen = (normal * view).sum(axis=1) > 0
    assert light.irradiances is not None
    for towards, power in zip(light.directions, light.irradiances):
        w = np.einsum("nij,i->nj", frames, towards)
        lit = seen & (w[:, 2] > 0)
        if lit.any():
            found[lit] += b.evaluate_vectors(w[lit], local_view[lit]) * (w[lit, 2:] * power)
    if b.has_delta and seen.any() and light.coefficients.any():
        x, y, z = local_view[seen].T
        back = 2 * z[:, None] * normal[seen] - view[seen]
        mirrored = b.delta_reflectance(np.minimum(np.arctan2(np.hypot(x, y), z), np.pi / 2))
        found[seen] += light.radiance(back) * mirrored
    return found


class _LightMatrices:
    """J D_z(-alpha) c of one degree: two matrices times cos m alpha and sin m alpha of even and of odd l + m."""

    def __init__(self, l: int, c: Float64Array) -> None:  # noqa: E741
        j = swaps(_table(l))[l]
        channels, self.l = c.shape[1], l
        cos, sin = (np.zeros((l + 1, channels, (l + 2 - start) // 2, 2)) for start in (l % 2, 1 - l % 2))
        for l_odd, target in ((False, cos), (True, sin)):
            m = orders_of(l, l_odd, False)
            a, b = c[l + m], np.where((m > 0)[:, None], c[l - m], 0.0)
            # the turned coefficients: a cos + b sin for cosines, b cos - a sin for sines
            turned_cos = np.stack([a, b], axis=-1)
            turned_sin = np.stack([b, -a], axis=-1)[m > 0]
            rows = orders_of(l, l_odd, True)
            if not l_odd:
                target[m] = np.einsum("um,mct->ucmt", j.cosines, turned_cos)
                target[orders_of(l, True, False)] = _placed(j.mixed, turned_sin, m)
            else:
                target[orders_of(l, False, True)] = np.einsum("um,mct->ucmt", j.mixed.T, turned_cos)
                target[rows] = _placed(j.sines, turned_sin, m)
        self.cos, self.sin = (t.reshape((l + 1) * channels, -1) for t in (cos, sin))

    def times(self, waves: tuple[Float64Array, Float64Array]) -> tuple[Float64Array, Float64Array]:
        """a of cosines and of sines, (l + 1, channels, normals)."""
        even, odd = (waves[self.l % 2], waves[1 - self.l % 2])
        cos, sin = self.cos @ even[: self.cos.shape[1]], self.sin @ odd[: self.sin.shape[1]]
        return cos.reshape(self.l + 1, -1, even.shape[1]), sin.reshape(self.l + 1, -1, even.shape[1])


def _placed(j: Float64Array, turned: Float64Array, m: npt.NDArray[np.int64]) -> Float64Array:
    """J times turned sines, with a column of 0 for m = 0 where the class has one."""
    found = np.zeros((len(j), turned.shape[1], len(m), 2))
    found[:, :, m > 0] = np.einsum("um,mct->ucmt", j, turned)
    return found


def _light_matrices(light: Light) -> list[_LightMatrices]:
    return [_LightMatrices(l, light.coefficients[l * l : (l + 1) ** 2]) for l in range(light.lmax + 1)]  # noqa: E741


def _interleaved(angle: Float64Array) -> tuple[Float64Array, Float64Array]:
    """cos and sin of every even order, one after the other, and of every odd one: prefixes serve lower degrees."""
    both = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return both[0::2].reshape(-1, angle.shape[1]), both[1::2].reshape(-1, angle.shape[1])


def _table(lmax: int) -> int:
    """J of a power of two: few tables for many degrees."""
    return min(max(1 << max(lmax - 1, 0).bit_length(), 32), MAX_ROTATED)


def _angles(normal: Float64Array, view: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Euler angles of the frames with the normal along z and the view at phi = 0; any gamma where they coincide."""
    x, y, z = normal.T
    alpha, beta = np.arctan2(y, x), np.arctan2(np.hypot(x, y), z)
    first = np.stack([np.cos(alpha) * np.cos(beta), np.sin(alpha) * np.cos(beta), -np.sin(beta)], axis=1)
    second = np.stack([-np.sin(alpha), np.cos(alpha), np.zeros_like(alpha)], axis=1)
    return alpha, beta, np.arctan2((view * second).sum(axis=1), (view * first).sum(axis=1))


def _cosine(normal: Float64Array, view: Float64Array) -> Float64Array:
    """cos theta_o of unit vectors; near 1 from the sine, as rounding of the product would move theta_o by 1e-8."""
    product = (normal * view).sum(axis=1)
    sine = np.minimum(np.linalg.norm(np.cross(normal, view), axis=1), 1.0)
    return np.asarray(np.where(product > 0.8, np.sqrt((1 - sine) * (1 + sine)), np.minimum(product, 1.0)))


def _frames(normal: Float64Array, view: Float64Array) -> Float64Array:
    """(n, 3, 3): columns are the axes x, y, z of those frames, in the world."""
    alpha, beta, gamma = _angles(normal, view)
    ca, sa, cb, sb, cg, sg = (f(t) for t in (alpha, beta, gamma) for f in (np.cos, np.sin))
    first = np.stack([ca * cb, sa * cb, -sb], axis=1)
    second = np.stack([-sa, ca, np.zeros_like(sa)], axis=1)
    x = cg[:, None] * first + sg[:, None] * second
    return np.stack([x, np.cross(normal, x), normal], axis=2)


def flatten_pairs(normals: npt.ArrayLike, views: npt.ArrayLike) -> Vectors:
    """Unit (n, 3) normals and views, broadcast; `InputError` that calls them so."""
    try:
        return flatten_vectors(normals, views)
    except InputError as error:
        names = {"wi": "normals", "wo": "views"}

        def named(text: str) -> str:
            return re.sub(r"\b(wi|wo)\b", lambda found: names[found[0]], text)

        context = {k: named(v) if isinstance(v, str) else v for k, v in error.context.items()}
        raise InputError(error.code, named(error.detail), **context) from error


def relight(
    b: Brdf,
    light: Light,
    normals: npt.ArrayLike,
    views: npt.ArrayLike,
    *,
    expansion: HarmonicExpansion | None = None,
    progress: Progress | None = None,
) -> Float64Array:
    """Radiance towards `views` from surfaces of material `b` with these `normals`, under `light`.

    Parameters
    ----------
    b : Brdf
        Directional lights and the mirror part are reflected by `b` itself, exactly; environments by its expansion.
    light : Light
        Environment and directional lights.
    normals, views : array_like
        Of shape (..., 3), away from the surface, in the frame of the light; they broadcast.
    expansion : HarmonicExpansion, optional
        Of `b`, from `bc.project`; default: made here, to the degree of the light.
    progress : callable(done, total, stage), optional

    Returns
    -------
    numpy.ndarray
        Radiance, float64 (..., channels); 0 where the view is below the surface. How far it may be off near the
        horizon of the view: `Transfer.radiance`.

    >>> white, up = bc.model("lambert", reflectance=0.5), [0.0, 0.0, 1.0]
    >>> sun = bc.Light.directional([0.0, 3.0**0.5, 1.0], np.pi)  # at 60 degrees: rho/pi E cos(60)
    >>> bc.relight(white, sun, normals=up, views=up).round(6)
    array([0.25])
    """
    if not isinstance(light, Light):
        raise InputError("bad_light", "light: expected a brdfcore.Light, for example Light.from_map(pixels)")
    given = flatten_pairs(normals, views)
    Channels.common(b.channels, light.channels)
    found = directly(b, light, given.wi, given.wo)
    if light.coefficients.any():
        made = expansion if expansion is not None else b if isinstance(b, HarmonicExpansion) else None
        made = made if made is not None else expanded(b, max(light.lmax, 1), progress=progress)
        found = found + Transfer(made, light.lmax).environment(light, given.wi, given.wo, progress)
    return found.reshape(*given.shape, -1)
