"""A table as a function of arrays: numpy, torch, jax, cupy, dask, ..., with derivatives where the library has them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import broadcast_shape
from brdfcore.base.errors import InputError, missing_extra
from brdfcore.out.array_file import as_table
from brdfcore.tables.base.table import Table

_ANGLES, _VECTORS = ("theta_i", "theta_o", "delta_phi"), ("wi", "wo")


def array_function(table: Brdf) -> ArrayFunction:
    """`table` (half_difference, lobe_grid, angle_grid or vndf_warp) as a function of arrays of any array-API library.

    Raises `InputError` for another material or representation, `MissingExtraError` without array-api-compat.

    >>> f = bc.array_function(bc.tabulate(bc.model("lambert", reflectance=0.5), "angle_grid", shape=(3, 3, 3)))
    >>> f(np.asarray([0.2, 0.4]), 0.3, np.pi).round(6)
    array([[0.159155],
           [0.159155]])
    """
    _compat()
    return ArrayFunction(as_table(table))


class ArrayFunction:
    """f_r of a table, in 1/sr without the cosine, of arrays of any library, and answered in it.

    f(theta_i, theta_o, delta_phi)   radians, broadcast; shape broadcast + (channels,)
    f.vectors(wi, wo)                (..., 3), normal +z; 0 where either has z <= 0

    Arrays are float32 or float64 of one library; Python numbers go beside them. The result has their type and stands
    on their device. Nothing is raised for values, which a compiled or recorded function cannot: an angle outside its
    domain, and a vector that is not finite or whose length is not within [1e-6, 1e6], give NaN.

    nodes  what the table holds, by name, as numpy arrays; halves and words are decoded. Given as `nodes=`, some of them
           replace the table's own, as arrays of the library of the angles: derivatives by them are those by the nodes.
           Under jax.jit they are best given so (`nodes=f.nodes_like(x)`): they are then no constants of the program.

    Derivatives are those of the interpolation: one-sided at a node, finite everywhere, 0 where a direction has
    none (the azimuth at the normal, the lobe's centre itself).

    With dask every block is computed by numpy on its own.
    """

    def __init__(self, table: Table) -> None:
        self.channels = table.channels
        self._look_up = table.array_look_up()
        self.nodes: dict[str, npt.NDArray[Any]] = self._look_up.nodes
        self._held: dict[Any, dict[str, Any]] = {}

    def __call__(self, theta_i: Any, theta_o: Any, delta_phi: Any, *, nodes: Mapping[str, Any] | None = None) -> Any:
        xp, arrays = _of_one_library(_ANGLES, (theta_i, theta_o, delta_phi))
        if _is_dask(xp):
            return self._by_blocks(xp, self, arrays, nodes)
        arrays = xp.broadcast_arrays(*arrays)
        flat = [xp.reshape(a, (-1,)) for a in arrays]
        module, _, settings = self._look_up
        f = module.from_angles(xp, *flat, self._nodes(xp, flat[0], nodes), settings)
        return xp.reshape(f, (*arrays[0].shape, len(self.channels)))

    def vectors(self, wi: Any, wo: Any, *, nodes: Mapping[str, Any] | None = None) -> Any:
        """f_r of directions (..., 3)."""
        xp, arrays = _of_one_library(_VECTORS, (wi, wo))
        for name, array in zip(_VECTORS, arrays):
            if array.ndim == 0 or array.shape[-1] != 3:
                raise InputError(
                    "bad_vectors",
                    f"{name}: shape {tuple(array.shape)}; expected (..., 3)",
                    where=name,
                    got=str(tuple(array.shape)),
                    expected="(..., 3)",
                )
        if _is_dask(xp):
            return self._by_blocks(xp, self.vectors, arrays, nodes)
        arrays = xp.broadcast_arrays(*arrays)
        flat = [xp.reshape(a, (-1, 3)) for a in arrays]
        module, _, settings = self._look_up
        f = module.from_vectors(xp, *flat, self._nodes(xp, flat[0], nodes), settings)
        return xp.reshape(f, (*arrays[0].shape[:-1], len(self.channels)))

    def nodes_like(self, x: Any) -> dict[str, Any]:
        """The nodes as arrays of the library, number type and device of x."""
        from array_api_compat import device

        xp, (x,) = _of_one_library(("x",), (x,))
        return {name: self._node(xp, array, x.dtype, device(x)) for name, array in self.nodes.items()}

    def _nodes(self, xp: Any, x: Any, given: Mapping[str, Any] | None) -> dict[str, Any]:
        from array_api_compat import device, is_jax_namespace

        given = dict(given or {})
        unknown = sorted(set(given) - set(self.nodes))
        if unknown:
            raise InputError(
                "unknown_nodes",
                f"nodes: no {', '.join(unknown)}; this table has {', '.join(self.nodes)}",
                where="nodes",
                got=", ".join(unknown),
                expected=", ".join(self.nodes),
            )
        for name, array in given.items():
            if tuple(array.shape) != self.nodes[name].shape:
                raise InputError(
                    "bad_nodes",
                    f"nodes: {name} has shape {tuple(array.shape)}; expected {self.nodes[name].shape}",
                    where="nodes",
                    got=str(tuple(array.shape)),
                    expected=str(self.nodes[name].shape),
                )
        if len(given) == len(self.nodes):
            return given
        if is_jax_namespace(xp):  # may be recording: what is made meanwhile cannot be kept
            return {**self.nodes_like(x), **given}
        key = (xp.__name__, str(x.dtype), str(device(x)))
        if key not in self._held:
            self._held[key] = self.nodes_like(x)
        return {**self._held[key], **given}

    @staticmethod
    def _node(xp: Any, array: npt.NDArray[Any], dtype: Any, device: Any) -> Any:
        """Numbers take the type of the angles; indices that in which the library counts."""
        if array.dtype.kind == "i":
            return xp.asarray(array, device=device)
        single = float(xp.finfo(dtype).eps) > 1e-10
        return xp.asarray(array.astype(np.float32 if single else np.float64, copy=False), dtype=dtype, device=device)

    def _by_blocks(self, xp: Any, function: Any, arrays: list[Any], nodes: Mapping[str, Any] | None) -> Any:
        """Of dask arrays: numpy, block by block."""
        import dask.array as da  # type: ignore[import-not-found,import-untyped,unused-ignore]

        arrays = da.broadcast_arrays(*arrays)
        vectors = len(arrays) == 2
        arrays = [a.rechunk({a.ndim - 1: -1}) for a in arrays] if vectors else arrays
        last = arrays[0].ndim - 1 if vectors else arrays[0].ndim
        chunks = (*arrays[0].chunks[:last], (len(self.channels),))
        arrays = [a.rechunk(arrays[0].chunks) for a in arrays]
        return da.map_blocks(
            function, *arrays, nodes=nodes, dtype=arrays[0].dtype, chunks=chunks,
            **({} if vectors else {"new_axis": last}), meta=np.empty((0,) * (last + 1), arrays[0].dtype),
        )  # fmt: skip


def _compat() -> Any:
    try:
        import array_api_compat
    except ModuleNotFoundError as error:
        raise missing_extra("array_api_compat", "arrays", "a function of arrays") from error
    return array_api_compat


def _is_dask(xp: Any) -> bool:
    found: bool = _compat().is_dask_namespace(xp)
    return found


def _of_one_library(names: tuple[str, ...], given: tuple[Any, ...]) -> tuple[Any, list[Any]]:
    """The namespace of the arrays given, and all of them as arrays of one float type."""
    compat = _compat()
    arrays = [x for x in given if not isinstance(x, (int, float))]
    listed = ", ".join(f"{n} {type(x).__module__}.{type(x).__name__}" for n, x in zip(names, given))
    try:
        xp = compat.array_namespace(*arrays) if arrays else compat.array_namespace(np.empty(0))
    except TypeError as error:
        raise InputError(
            "not_arrays",
            f"expected arrays of one array-API library and Python numbers; got {listed}",
            where=", ".join(names),
            got=listed,
            expected="arrays of one library",
        ) from error
    dtype = xp.result_type(*(x.dtype for x in arrays)) if arrays else xp.float64
    if dtype not in (xp.float32, xp.float64):
        raise InputError(
            "not_floats",
            f"{', '.join(names)}: expected arrays of float32 or float64, got {dtype}",
            where=", ".join(names),
            got=str(dtype),
            expected="float32 or float64",
        )
    vectors = len(names) == 2
    shapes = tuple(tuple(getattr(x, "shape", ()))[: -1 if vectors else None] for x in given)
    if not compat.is_dask_namespace(xp):  # whose shapes may be unknown
        broadcast_shape(names, shapes)
    place = compat.device(arrays[0]) if arrays else None
    found = []
    for x in given:
        if isinstance(x, (int, float)):
            x = xp.asarray(x if math.isfinite(x) else math.nan, dtype=dtype, device=place)
        found.append(xp.astype(x, dtype, copy=False))
    return xp, found
