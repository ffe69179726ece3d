"""Refractive indices by name, and the `ior` grammar that every model reads them through.

n + ik with k >= 0, for fields that vary as exp(-i omega t); dimensionless.

A name alone is one index at 589 nm (`CONSTANTS`). With `wavelengths=` it is one index a wavelength, from the measured
tables of `optical_tables`: another sample and another laboratory, so gold's table has .274 + 2.944i at 589 nm where the
course tables have .370 + 2.820i.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from numbers import Complex, Real
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.channels import Channels
from brdfcore.base.errors import InputError, UnknownNameError
from brdfcore.base.parameters import Parameter
from brdfcore.models.base import optical_tables
from brdfcore.models.base.model import channels_for

Complex128Array = npt.NDArray[np.complex128]

#: Indices at 589 nm (sodium D), from common course tables; chromium, nickel and aluminium are the values of their
#: tables in `optical_tables` there. Metals differ by several percent between samples.
CONSTANTS: Mapping[str, complex] = MappingProxyType(
    {
        "gold": complex(0.370, 2.820),
        "silver": complex(0.177, 3.638),
        "copper": complex(0.617, 2.63),
        "steel": complex(2.485, 3.433),
        "chromium": complex(3.21, 3.30),
        "nickel": complex(1.966, 3.844),
        "aluminium": complex(1.205, 7.064),
        "vacuum": complex(1.0),
        "air": complex(1.00029),
        "ice": complex(1.31),
        "water": complex(1.333),
        "fused_quartz": complex(1.46),
        "glass": complex(1.5),
        "sapphire": complex(1.77),
        "diamond": complex(2.42),
    }
)

IOR = Parameter("ior", "n + ik", "index of refraction of the material", None, kind="ior")
EXTERIOR_IOR = Parameter("exterior_ior", "n_e", "index of the medium in front", 1.0, bounds=(1e-3, 1e3))
WAVELENGTHS = Parameter(
    "wavelengths",
    "lambda",
    "one channel for each, with the index that the table of a named ior has there",
    None,
    kind="wavelengths",
    bounds=(0.0, np.inf),
    open_bounds=("low",),
    unit="nm",
)

#: Bounds of n and of k: beyond any material, and far from where (n^2 + k^2)^2 overflows or underflows.
SMALLEST_N, LARGEST = 1e-6, 1e6

_GRAMMAR = (
    "a number n, a complex number or tuple (n, k), {'n': ..., 'k': ...}, a name, or a list of these, one per channel"
)


def constant(name: str) -> complex:
    """n + ik at 589 nm of a named material; `UnknownNameError` with close names on a miss.

    Upper case, spaces and hyphens are accepted: "Fused quartz" is "fused_quartz".
    """
    key = _key(name)
    if key in CONSTANTS:
        return CONSTANTS[key]
    close = difflib.get_close_matches(key, CONSTANTS, n=3, cutoff=0.5)
    meant = f"; did you mean {' or '.join(repr(c) for c in close)}?" if close else "."
    listed = ", ".join(CONSTANTS)
    raise UnknownNameError(
        "unknown_optical_constant",
        f"no optical constant is called {name[:80]!r}{meant} Known: {listed}",
        where="ior",
        got=name[:80],
        expected=listed,
    )


def parse_ior(owner: str, ior: Any) -> Complex128Array:
    """`ior` as n + ik, complex128, shape (channels,); one entry means the same index for every channel.

    - number: n, k = 0. Complex number or TUPLE of two: (n, k).
    - LIST (or 1-D array): one entry per channel, each entry anything else of this grammar. So [1.5, 1.6] is two
      channels, also when it comes from JSON, which has no tuples and writes {"n": ..., "k": ...}.
    - {"n": number or list, "k": number or list}: k is 0 if left out.
    - a name: `constant`.

    Range: 1e-6 <= n <= 1e6, 0 <= k <= 1e6. Raises `InputError`, or `UnknownNameError` for a name not known.
    """
    if isinstance(ior, np.ndarray):
        ior = ior.tolist()
    if isinstance(ior, list):
        if not ior:
            raise _error(owner, ior, "at least one channel")
        values = [_single(owner, x) for x in ior]
    elif isinstance(ior, Mapping):
        values = _mapping(owner, ior)
    else:
        values = [_single(owner, ior)]
    for value in values:
        if not (SMALLEST_N <= value.real <= LARGEST and 0 <= value.imag <= LARGEST):  # NaN fails too
            limits = f"{SMALLEST_N:g} <= n <= {LARGEST:g} and 0 <= k <= {LARGEST:g}"
            raise _error(owner, ior, f"{limits} (absorption is k > 0)")
    return np.array(values, dtype=np.complex128)


def material_index(owner: str, ior: Any, wavelengths: Any) -> Complex128Array | None:
    """The index of a model's parameters `ior` and `wavelengths` (nm): n + ik, (channels,), or None without an ior.

    With wavelengths the ior has to be one name with a table (`tabulated`); without them see `parse_ior`.
    """
    if wavelengths is None:
        return None if ior is None else parse_ior(owner, ior)
    if not isinstance(ior, str):
        raise InputError(
            "bad_parameter",
            f"{owner}: wavelengths are given, and ior = {_shown(ior)} is no name; with wavelengths expected one of "
            f"{', '.join(optical_tables.TABLES)}, or a list of indices without wavelengths",
            where="wavelengths",
            got=_shown(ior),
            expected="an ior by name",
        )
    return tabulated(owner, ior, wavelengths)


def tabulated(owner: str, name: str, wavelengths: npt.ArrayLike) -> Complex128Array:
    """n + ik of a named metal at each wavelength (nm), its table's n and k interpolated linearly; (wavelengths,).

    Raises `InputError` outside the table's range, naming it, and for a name without a table; `UnknownNameError` for a
    name that is not known at all.
    """
    key = _key(name)
    constant(key)
    if key not in optical_tables.TABLES:
        raise InputError(
            "bad_parameter",
            f"{owner}: {key!r} is known at 589 nm only and takes no wavelengths; tables exist for "
            f"{', '.join(optical_tables.TABLES)}",
            where="wavelengths",
            got=key,
            expected=", ".join(optical_tables.TABLES),
        )
    nm, n, k = optical_tables.table(key)
    asked = np.atleast_1d(np.asarray(wavelengths, dtype=np.float64))
    outside = ~((asked >= nm[0]) & (asked <= nm[-1]))
    if outside.any():
        raise InputError(
            "bad_parameter",
            f"{owner}: wavelengths = {float(asked[outside][0]):g} nm is outside the table of {key!r}, "
            f"{nm[0]:g} to {nm[-1]:g} nm",
            where="wavelengths",
            got=float(asked[outside][0]),
            expected=f"[{nm[0]:g}, {nm[-1]:g}] nm",
        )
    return np.asarray(np.interp(asked, nm, n) + 1j * np.interp(asked, nm, k))


def channels_of(owner: str, wavelengths: Any, *values: Any) -> Channels:
    """Channels of a model whose other parameters are `values`: the wavelengths where given, else `channels_for`."""
    if wavelengths is None:
        return channels_for(owner, *values)
    channels = Channels([float(x) for x in np.atleast_1d(wavelengths)], "wavelength")
    sizes = {np.size(v) for v in values if v is not None and np.size(v) > 1}
    if sizes - {len(channels)}:
        raise InputError(
            "channels_differ",
            f"{owner}: {len(channels)} wavelengths, and parameters given for {sorted(sizes)} channels; give one number "
            "each, or one a wavelength",
            where="wavelengths",
            got=sorted(sizes),
            expected=len(channels),
        )
    return channels


def ior_to_json(ior: Any) -> Any:
    """`ior` as JSON that `parse_ior` reads back: a name, a number, {"n", "k"}, or a list of them."""
    if ior is None or isinstance(ior, str):
        return ior
    if isinstance(ior, np.ndarray):
        ior = ior.tolist()
    if isinstance(ior, list):
        return [ior_to_json(x) for x in ior]
    if isinstance(ior, Mapping):
        return {key: np.asarray(value).tolist() for key, value in ior.items()}
    value = _single("ior", ior)
    return value.real if isinstance(ior, Real) else {"n": value.real, "k": value.imag}


def _single(owner: str, ior: Any) -> complex:
    if isinstance(ior, str):
        return constant(ior)
    if isinstance(ior, Mapping):
        values = _mapping(owner, ior)
        if len(values) > 1:
            raise _error(owner, ior, "one n and one k inside a list")
        return values[0]
    if isinstance(ior, tuple):
        if len(ior) != 2 or not all(_is_real(x) for x in ior):
            raise _error(owner, ior, "a tuple of two numbers (n, k)")
        return complex(float(ior[0]), float(ior[1]))
    if not isinstance(ior, bool) and isinstance(ior, Complex):
        try:
            return complex(ior)
        except OverflowError as error:
            raise _error(owner, ior, _GRAMMAR) from error
    raise _error(owner, ior, _GRAMMAR)


def _mapping(owner: str, ior: Mapping[Any, Any]) -> list[complex]:
    if "n" not in ior or set(ior) - {"n", "k"}:
        raise _error(owner, ior, "the keys 'n' and 'k'")
    parts = []
    for key in ("n", "k"):
        value = ior.get(key, 0.0)
        part = list(value) if isinstance(value, (list, tuple, np.ndarray)) else [value]
        if not part or not all(_is_real(x) for x in part):
            raise _error(owner, ior, f"numbers as {key!r}")
        parts.append([float(x) for x in part])
    count = max(len(p) for p in parts)
    if any(len(p) not in (1, count) for p in parts):
        raise _error(owner, ior, "as many n as k")
    n, k = (p * count if len(p) == 1 else p for p in parts)
    return [complex(a, b) for a, b in zip(n, k, strict=True)]


def _is_real(value: Any) -> bool:
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond float64
        return False


def _key(name: str) -> str:
    return name.strip().lower().replace(" ", "_").replace("-", "_")


def _shown(ior: Any) -> str:
    return repr(ior) if len(repr(ior)) <= 80 else repr(ior)[:77] + "..."


def _error(owner: str, ior: Any, expected: str) -> InputError:
    shown = _shown(ior)
    return InputError(
        "bad_parameter",
        f"{owner}: ior = {shown} is not allowed; expected {expected}",
        where="ior",
        got=shown,
        expected=expected,
    )
