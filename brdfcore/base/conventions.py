"""Frame, units, domain and number types: the one home of the project's conventions.

Frame. The surface normal is +z. `wi` points to the light, `wo` to the viewer, both away from the
surface. `delta_phi` = phi_o - phi_i, so the mirror direction is theta_o = theta_i, delta_phi = pi,
and retro-reflection is theta_o = theta_i, delta_phi = 0.

Value. f_r in 1/sr, without the cosine. The last axis of a value array is the channel.

Units. Radians and nanometres. Degrees exist at the edges only (HTTP, shell, plots) and are turned
into radians by `numpy.radians` only, so that every entry point computes the same bits.

Domain. theta in [0, pi/2], the pi/2 of the type it is given in: float32(pi/2) exceeds pi/2 by 4.4e-8 and, given
as float32, is accepted and means pi/2 (also beside float64 arguments). Anything else outside is an error naming
argument, index and value, unless `outside="nan"` or `outside="clip"` asks for another answer.

Number types. float32 results only if all inputs are float32, else float64.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from brdfcore.base.errors import InputError

FloatArray = npt.NDArray[np.floating[Any]]
Outside = Literal["raise", "nan", "clip"]

HALF_PI = np.pi / 2
#: Largest theta accepted as float32; above HALF_PI, which is the largest accepted as float64. Compared with an array,
#: the Python number HALF_PI takes the array's type, so that `theta <= HALF_PI` holds each type to its own limit.
THETA_MAX = float(np.float32(HALF_PI))
#: pi = PI_HI + PI_LO to 106 bits; pi itself is no float64.
PI_HI, PI_LO = np.pi, 1.2246467991473532e-16
#: |delta_phi| up to which the compiled kernels reduce it themselves; beyond, `reduce_delta_phi` does.
DELTA_PHI_DIRECT = 3 * np.pi

ANGLE_NAMES = ("theta_i", "theta_o", "delta_phi")


class Angles(NamedTuple):
    """Checked angles: flat, contiguous, of one dtype and length; `shape` is the broadcast shape.

    `outside` is None or a boolean array marking points whose value is NaN (`outside="nan"`).
    """

    theta_i: FloatArray
    theta_o: FloatArray
    delta_phi: FloatArray
    shape: tuple[int, ...]
    outside: npt.NDArray[np.bool_] | None


def as_float(name: str, value: npt.ArrayLike) -> FloatArray:
    """`value` as a float32 or float64 array; float32 only if it already is float32.

    Raises `InputError` for what is not real numbers (text, complex, ragged lists, objects).
    """
    if type(value) is np.ndarray and (value.dtype == np.float64 or value.dtype == np.float32):
        return value
    try:
        array = np.asarray(value)
    except (ValueError, TypeError) as error:
        raise InputError(
            "not_numbers", f"{name}: cannot be read as an array of numbers ({error})", where=name
        ) from error
    if array.dtype == np.float32 or array.dtype == np.float64:
        # also brings foreign byte order to the native one
        return array.astype(array.dtype.newbyteorder("="), copy=False)
    if array.dtype.kind not in "fiu":
        raise InputError(
            "not_numbers",
            f"{name}: expected real numbers, got an array of {array.dtype}",
            where=name,
            got=str(array.dtype),
            expected="real numbers",
        )
    return array.astype(np.float64)


def broadcast_shape(names: tuple[str, ...], shapes: tuple[tuple[int, ...], ...]) -> tuple[int, ...]:
    """Broadcast shape, or an `InputError` that lists the shapes by name."""
    try:
        return np.broadcast_shapes(*shapes)
    except ValueError as error:
        listed = ", ".join(f"{name} {shape}" for name, shape in zip(names, shapes, strict=True))
        raise InputError(
            "shapes_do_not_broadcast",
            f"the shapes do not broadcast: {listed}; give equal shapes, or length-1 axes",
            where=", ".join(names),
            got=listed,
            expected="shapes that broadcast",
        ) from error


def flatten_angles(theta_i: npt.ArrayLike, theta_o: npt.ArrayLike, delta_phi: npt.ArrayLike) -> Angles:
    """Broadcast and flatten without checking the domain (`check_domain` does).

    Inputs that are already flat, equal in shape and dtype and contiguous are passed through uncopied.
    """
    a, b, c = as_float("theta_i", theta_i), as_float("theta_o", theta_o), as_float("delta_phi", delta_phi)
    dtype = a.dtype if a.dtype == b.dtype == c.dtype else np.dtype(np.float64)
    if dtype == np.float64:
        a, b = _promoted_theta(a), _promoted_theta(b)
    if a.shape == b.shape == c.shape:
        shape = a.shape
    else:
        shape = broadcast_shape(ANGLE_NAMES, (a.shape, b.shape, c.shape))
        a, b, c = np.broadcast_to(a, shape), np.broadcast_to(b, shape), np.broadcast_to(c, shape)
    # ascontiguousarray copies only what is strided, of another dtype or not native
    flat = [np.ascontiguousarray(x, dtype=dtype).reshape(-1) for x in (a, b, c)]
    # a kernel compiled for read-only or unaligned memory would be another version, seconds of compiling: copy instead
    flat = [x if x.flags.behaved else x.copy() for x in flat]
    return Angles(flat[0], flat[1], flat[2], shape, None)


def plain_floats(theta_i: Any, theta_o: Any, delta_phi: Any) -> npt.NDArray[np.float64] | None:
    """The three as one array if they are floats (numpy's too, not float32) in the plain domain; None otherwise."""
    if (
        isinstance(theta_i, float)
        and isinstance(theta_o, float)
        and isinstance(delta_phi, float)
        and 0 <= theta_i <= HALF_PI
        and 0 <= theta_o <= HALF_PI
        and -DELTA_PHI_DIRECT <= delta_phi <= DELTA_PHI_DIRECT
    ):
        return np.array((theta_i, theta_o, delta_phi))
    return None


def _promoted_theta(theta: FloatArray) -> FloatArray:
    """theta in float64; float32's pi/2 becomes float64's, which it means."""
    if theta.dtype == np.float64:
        return theta
    return np.where(theta == np.float32(HALF_PI), HALF_PI, theta.astype(np.float64))


def _complain(angles: Angles, name: str, values: FloatArray, bad: npt.NDArray[np.bool_], expected: str) -> InputError:
    flat = int(np.flatnonzero(bad)[0])
    index = [int(i) for i in np.unravel_index(flat, angles.shape)] if angles.shape else []
    got = float(values[flat])
    place = f"{name}{index if index else ''}"
    hint = "radians; angles past the horizon have no value: pass outside='nan' or 'clip' to say what they mean"
    return InputError(
        "angle_outside",
        f"{place} = {got!r} is outside {expected} ({hint}); {int(bad.sum())} such value(s)",
        where=name,
        index=index,
        got=got if np.isfinite(got) else str(got),
        expected=expected,
        hint=hint,
    )


def check_domain(angles: Angles, outside: Outside = "raise") -> Angles:
    """Hold flat angles to the domain and reduce delta_phi beyond `DELTA_PHI_DIRECT`.

    outside="raise": `InputError` naming argument, index and value of the first offender.
    outside="nan": offenders are marked in `.outside` and replaced by a valid angle.
    outside="clip": theta is clipped to [0, pi/2]; NaN, and a delta_phi that is not finite, still raise.
    """
    if outside not in ("raise", "nan", "clip"):
        raise InputError(
            "bad_option",
            f"outside={outside!r}: expected 'raise', 'nan' or 'clip'",
            where="outside",
            got=str(outside),
            expected="'raise', 'nan' or 'clip'",
        )
    mask = np.zeros(angles.theta_i.shape, np.bool_)
    thetas: list[FloatArray] = []
    for name, theta in (("theta_i", angles.theta_i), ("theta_o", angles.theta_o)):
        bad = ~((theta >= 0) & (theta <= HALF_PI))  # written so that NaN is bad; each type's own pi/2
        if bad.any():
            if outside == "raise":
                raise _complain(angles, name, theta, bad, "[0, pi/2]")
            if outside == "clip":
                nan = np.isnan(theta)
                if nan.any():
                    raise _complain(angles, name, theta, nan, "[0, pi/2]")
                theta = np.clip(theta, 0, theta.dtype.type(HALF_PI))
            else:
                mask |= bad
                theta = np.where(bad, theta.dtype.type(0), theta)
        thetas.append(theta)
    delta_phi = angles.delta_phi
    bad = ~np.isfinite(delta_phi)
    if bad.any():
        if outside != "nan":
            raise _complain(angles, "delta_phi", delta_phi, bad, "the finite numbers")
        mask |= bad
        delta_phi = np.where(bad, delta_phi.dtype.type(0), delta_phi)
    far = np.abs(delta_phi) > DELTA_PHI_DIRECT
    if far.any():
        delta_phi = delta_phi.copy()
        delta_phi[far] = reduce_delta_phi(delta_phi[far].astype(np.float64)).astype(delta_phi.dtype)
    return Angles(thetas[0], thetas[1], delta_phi, angles.shape, mask if mask.any() else None)


def reduce_delta_phi(delta_phi: FloatArray) -> FloatArray:
    """delta_phi (float64, finite) modulo 2 pi, in [-pi, pi] up to rounding; |delta_phi| <= pi is returned as it is.

    fmod is exact for the float64 nearest 2 pi; what that float64 lacks (2 PI_LO a turn) is taken
    off afterwards. Above about 1e15 neighbouring floats are turns apart and the angle means nothing;
    it stays finite.
    """
    two_pi = 2 * PI_HI
    rest = np.fmod(delta_phi, two_pi)
    turns = np.rint((delta_phi - rest) / two_pi)
    over = np.where(rest > PI_HI, 1.0, np.where(rest < -PI_HI, -1.0, 0.0))
    reduced = (rest - over * two_pi) - (turns + over) * (2 * PI_LO)
    # beyond 2**53 turns the correction is larger than a turn and meaningless
    reduced = np.where(np.abs(turns) < 2.0**52, reduced, rest - over * two_pi)
    # after many turns the correction may have pushed it past half a turn again
    past = np.where(reduced > PI_HI, 1.0, np.where(reduced < -PI_HI, -1.0, 0.0))
    reduced = (reduced - past * two_pi) - past * (2 * PI_LO)
    return np.where(np.abs(delta_phi) <= PI_HI, delta_phi, reduced)


#: Binary exponents of a vector's largest component beyond which its square is not formed as it is.
_EXTREME = 16


class Vectors(NamedTuple):
    """Directions as (n, 3) arrays (float64 where checked), the broadcast shape and the result's dtype."""

    wi: npt.NDArray[Any]
    wo: npt.NDArray[Any]
    shape: tuple[int, ...]
    dtype: np.dtype[Any]


def flatten_vectors(wi: npt.ArrayLike, wo: npt.ArrayLike, *, unit: bool = True) -> Vectors:
    """Broadcast, check and normalise two sets of directions of shape (..., 3).

    Normalised in float64 whatever the input: rounding a unit vector back to float32 would move it by
    6e-8, more than the width of a sharp lobe. Without `unit` they only come to lengths from 1/2 to 4, by powers of two,
    which keeps their directions' bits. A zero, NaN or infinite vector is an `InputError`.
    Directions with z <= 0 are kept: the caller answers exactly 0 for them.
    """
    a, b, shape, dtype = _vector_arrays(wi, wo)
    made = _normalised if unit else _halved
    flat = [made(name, np.broadcast_to(v, (*shape, 3)).reshape(-1, 3), shape) for name, v in (("wi", a), ("wo", b))]
    return Vectors(flat[0], flat[1], shape, dtype)


def raw_vectors(wi: npt.ArrayLike, wo: npt.ArrayLike) -> Vectors:
    """Two sets of directions, broadcast, as (n, 3) contiguous arrays of the result's dtype; lengths are not checked
    and kept. Inputs that fit are passed through uncopied."""
    a, b, shape, dtype = _vector_arrays(wi, wo)
    full = [v if v.shape == (*shape, 3) else np.broadcast_to(v, (*shape, 3)) for v in (a, b)]
    flat = [np.ascontiguousarray(v, dtype=dtype).reshape(-1, 3) for v in full]
    # a kernel compiled for read-only or unaligned memory would be another version, seconds of compiling: copy instead
    flat = [v if v.flags.behaved else v.copy() for v in flat]
    return Vectors(flat[0], flat[1], shape, dtype)


def scaled_vectors(vectors: Vectors) -> Vectors:
    """Of `raw_vectors`: those of extreme length divided by a power of two, which keeps their direction's bits.

    A zero, NaN or infinite vector is an `InputError`.
    """
    scaled = []
    for name, v in (("wi", vectors.wi), ("wo", vectors.wo)):
        largest = _largest(name, v, vectors.shape)
        _, exponent = np.frexp(largest)
        extreme = np.abs(exponent) > _EXTREME
        scaled.append(np.where(extreme[:, None], np.ldexp(v, -exponent[:, None]), v))
    return Vectors(scaled[0], scaled[1], vectors.shape, vectors.dtype)


def _vector_arrays(
    wi: npt.ArrayLike, wo: npt.ArrayLike
) -> tuple[FloatArray, FloatArray, tuple[int, ...], np.dtype[Any]]:
    a, b = as_float("wi", wi), as_float("wo", wo)
    for name, v in (("wi", a), ("wo", b)):
        if v.ndim == 0 or v.shape[-1] != 3:
            raise InputError(
                "not_vectors",
                f"{name}: expected directions of shape (..., 3), got {v.shape}",
                where=name,
                got=list(v.shape),
                expected="(..., 3)",
            )
    dtype = a.dtype if a.dtype == b.dtype else np.dtype(np.float64)
    return a, b, broadcast_shape(("wi", "wo"), (a.shape[:-1], b.shape[:-1])), dtype


def _largest(name: str, v: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Largest component of each vector (n, 3) in magnitude; an `InputError` where it gives no direction."""
    largest: FloatArray = np.abs(v).max(axis=1, initial=0)
    bad = ~(np.isfinite(largest) & (largest > 0))  # np.max propagates NaN
    if bad.any():
        flat = int(np.flatnonzero(bad)[0])
        index = [int(i) for i in np.unravel_index(flat, shape)] if shape else []
        got = [float(x) if np.isfinite(x) else str(x) for x in v[flat]]
        raise InputError(
            "not_a_direction",
            f"{name}{index if index else ''} = {got} is no direction: expected finite and not zero",
            where=name,
            index=index,
            got=got,
            expected="a finite vector that is not zero",
        )
    return largest


def _normalised(name: str, v: FloatArray, shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    largest = _largest(name, v, shape)
    # scaled by the largest component first: squares of 1e-200 or 1e200 would under- or overflow
    exact = v.astype(np.float64)
    w = exact / largest.astype(np.float64)[:, None]
    with np.errstate(over="ignore", under="ignore"):
        norm = np.sqrt((w * w).sum(axis=1))
        unit = np.abs((exact * exact).sum(axis=1) - 1) <= 4 * np.finfo(np.float64).eps
    # what is unit to rounding keeps its bits
    return np.ascontiguousarray(np.where(unit[:, None], exact, w / norm[:, None]))


def _halved(name: str, v: FloatArray, shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    """Vectors over a power of two. Divided by their length they would move by 1e-16, and a lobe of roughness 1e-6, or
    the half vector of two grazing directions, would lose ten digits and more: `pair_from_vectors` does it."""
    _, exponent = np.frexp(_largest(name, v, shape))
    exact = v.astype(np.float64)
    usual = (exponent == 0) | (exponent == 1)
    with np.errstate(under="ignore"):
        return np.ascontiguousarray(np.where(usual[:, None], exact, np.ldexp(exact, -exponent[:, None])))


def prepare_out(out: FloatArray | None, shape: tuple[int, ...], dtype: np.dtype[Any]) -> FloatArray:
    """The result array: a new one, or `out` after checking that it fits exactly."""
    if out is None:
        return np.empty(shape, dtype)
    if not isinstance(out, np.ndarray) or out.shape != shape or out.dtype != dtype or not out.flags.writeable:
        got = f"{out.dtype} {out.shape}" if isinstance(out, np.ndarray) else type(out).__name__
        raise InputError(
            "bad_out",
            f"out: expected a writeable {dtype} array of shape {shape}, got {got}",
            where="out",
            got=got,
            expected=f"{dtype} {shape}",
        )
    return out


def to_radians(degrees: npt.ArrayLike) -> FloatArray:
    """Degrees to radians by `numpy.radians`, the only conversion used at any entry point.

    >>> bc.to_radians([0, 90, 180])
    array([0.        , 1.57079633, 3.14159265])
    """
    return np.asarray(np.radians(as_float("angle", degrees)))
