"""Wavelengths to linear sRGB or XYZ: what a BRDF looks like under a named illuminant.

Integrals of the CIE 1931 2 degree observer, the illuminant and the colour space come from the package `colour-science`,
which takes seconds to import: only when it is used.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.brdf import Brdf
from brdfcore.base.channels import RGB, Channels
from brdfcore.base.conventions import FloatArray
from brdfcore.base.errors import InputError, UnknownNameError, missing_extra

Float64Array = npt.NDArray[np.float64]

#: Wavelengths of the sums, nm: the observer's own range and step.
_WAVES = np.arange(360.0, 831.0)
#: Between these wavelengths, nm, lies 99.9 % of what the observer sees; measurements may not leave wider gaps there.
_SEEN = (400.0, 700.0)
XYZ = Channels(("X", "Y", "Z"))
_SPACES = {"sRGB": RGB, "XYZ": XYZ}
_INTERPOLATIONS = ("linear", "cie167")
#: Fewest equally spaced wavelengths that Sprague's polynomials take; steps this alike, nm, are equal.
_SPRAGUE, _ALIKE = 6, 1e-6


class Coloured(Brdf):
    """f_r of `part`, wavelengths summed to three channels by `matrix` (channels, 3); the delta part too."""

    def __init__(self, part: Brdf, matrix: Float64Array, channels: Channels) -> None:
        super().__init__()
        self.part, self.matrix, self.channels = part, matrix, channels
        self.bilateral, self.reciprocal, self.has_delta = part.bilateral, part.reciprocal, part.has_delta
        # a colour outside sRGB has a negative part; XYZ of what reflects at most all light has at most the white's
        self.non_negative = part.non_negative and bool((matrix >= 0).all())
        self.energy_conserving = part.energy_conserving and self.non_negative
        self._analytic, self._smooth_elsewhere = part._analytic, part._smooth_elsewhere

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[...] = _summed(self.part.evaluate(theta_i, theta_o, delta_phi), self.matrix)
        return True

    def _evaluate_vectors(self, wi: Float64Array, wo: Float64Array, out: FloatArray) -> None:
        values = np.empty((wi.shape[0], len(self.part.channels)), out.dtype)
        self.part._evaluate_vectors(wi, wo, values)
        out[...] = _summed(values, self.matrix)

    def _status(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray) -> npt.NDArray[np.uint8]:
        return self.part._status(theta_i, theta_o, delta_phi)

    def _uncertainty(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        # errors of neighbouring wavelengths go together: sizes are summed, not squares
        widths = self.part.uncertainty(theta_i, theta_o, delta_phi)
        out[...] = _summed(widths, np.abs(self.matrix))
        return True

    def _delta_reflectance(self, theta_i: Float64Array) -> Float64Array:
        return _summed(self.part._delta_reflectance(theta_i), self.matrix)


def _summed(values: FloatArray, matrix: Float64Array) -> Float64Array:
    """values (n, channels) times matrix (channels, 3), float64."""
    total = np.zeros((values.shape[0], 3))
    for k, row in enumerate(matrix):  # in one order: the same bits for one point and for a million
        total += values[:, k, None].astype(np.float64) * row
    return total


def to_rgb(
    b: Brdf,
    illuminant: str = "D65",
    *,
    space: str = "sRGB",
    largest_gap: float = 40.0,
    interpolation: str = "linear",
) -> Brdf:
    """`b`, whose channels are wavelengths, in linear sRGB or XYZ under `illuminant`.

    XYZ = sum f E (x, y, z) / sum E y at every nm, f constant beyond the wavelengths: what reflects all light is Y = 1.
    sRGB: adapted from the illuminant's white to D65 (Bradford), so that white is (1, 1, 1) under any; not gamma-coded,
    and not clipped: colours outside sRGB have negative values.

    illuminant     "D65", "D50", "A", "E", "FL2", ...: the CIE's names.
    space          "sRGB" or "XYZ".
    largest_gap    nm; wavelengths farther apart between 400 and 700 nm are an `InputError`: a colour can't be told
                   from a few laser lines. `metadata` and the report say what was done.
    interpolation  f between the wavelengths. "linear" never leaves the range of its neighbours. "cie167" is what CIE
                   167:2005 recommends: Sprague's fifth-order polynomials between equally spaced wavelengths (at least
                   six), a cubic spline between others; smooth spectra come out closer (at 10 nm the two are up to half
                   a Delta E*ab apart), a spectral line may ring below 0.

    Raises `InputError` if the channels are no wavelengths, `UnknownNameError` for an illuminant that is not known.

    >>> silver = bc.model("mirror", ior="silver", wavelengths=list(range(400, 701, 20)))
    >>> grey = bc.model("lambert", reflectance=0.5) + 0 * silver  # the same at each wavelength
    >>> (np.pi * bc.to_rgb(grey).evaluate(0.2, 0.3, 1.0)).round(3)
    array([0.5, 0.5, 0.5])
    """
    if b.channels.kind != "wavelength":
        raise InputError(
            "no_wavelengths",
            f"the channels are {', '.join(map(str, b.channels))[:80]}, not wavelengths: there is nothing to convert",
            where="channels",
            got=b.channels.to_json(),
            expected="wavelengths in nm",
        )
    if space not in _SPACES:
        raise InputError(
            "bad_option", f"space = {str(space)[:40]!r}: expected 'sRGB' or 'XYZ'", where="space", got=str(space)[:40]
        )
    waves = np.array(b.channels, np.float64)
    order = np.argsort(waves)
    inner = np.unique(np.clip(np.concatenate([waves, _SEEN]), *_SEEN))
    widest = max(float(np.diff(inner).max()), float(waves.min()) - _SEEN[0], _SEEN[1] - float(waves.max()))
    if not widest <= largest_gap:
        raise InputError(
            "too_few_wavelengths",
            f"the wavelengths {', '.join(f'{w:g}' for w in waves[order])[:120]} nm leave {widest:.0f} nm of 400 to 700 "
            f"nm open, more than largest_gap = {largest_gap:g}: colours would be guessed",
            where="channels",
            got=widest,
            expected=f"gaps of at most {largest_gap:g} nm",
        )
    if interpolation not in _INTERPOLATIONS:
        got = str(interpolation)[:40]
        expected = " or ".join(map(repr, _INTERPOLATIONS))
        raise InputError("bad_option", f"interpolation = {got!r}: expected {expected}", where="interpolation", got=got)
    weights, to_space, white = _observer(illuminant, space)
    hats, between = _interpolated(waves[order], interpolation)
    matrix = hats[np.argsort(order)] @ weights @ to_space
    made = Coloured(b, np.ascontiguousarray(matrix), _SPACES[space])
    beyond = float(weights[np.clip(_WAVES, waves.min(), waves.max()) != _WAVES, 1].sum())
    said = (
        f"{waves.size} wavelengths from {waves.min():g} to {waves.max():g} nm to "
        f"{'linear sRGB' if space == 'sRGB' else 'XYZ'} under illuminant {illuminant} "
        f"(white {white[0]:.4f}, {white[1]:.4f}, {white[2]:.4f}), CIE 1931 2 degree observer; {between} between "
        f"the wavelengths, constant beyond them, {beyond:.2%} of Y"
    )
    made.metadata = {**b.metadata, "colour": said}
    made.report = {**b.report, "done": [*b.report.get("done", []), said]} if b.report else {}
    source = getattr(b, "source", None)
    if source:
        made.source = dict(source)  # type: ignore[attr-defined]
    return made


def _interpolated(waves: Float64Array, interpolation: str) -> tuple[Float64Array, str]:
    """(what 1 at each of the rising `waves` and 0 at the others is at `_WAVES`, (waves, 471); the method's name)."""
    units = np.eye(waves.size)
    if interpolation == "linear" or waves.size < 3:
        return np.stack([np.interp(_WAVES, waves, unit) for unit in units]), "linear"
    import colour  # `_observer` has said if it is missing

    steps = np.diff(waves)
    equal = waves.size >= _SPRAGUE and float(np.ptp(steps)) <= _ALIKE
    method: Any = colour.SpragueInterpolator if equal else colour.CubicSplineInterpolator
    inside = np.clip(_WAVES, waves[0], waves[-1])
    found = np.stack([np.asarray(method(waves, unit)(inside), np.float64) for unit in units])
    return found, "Sprague (CIE 167:2005)" if equal else "cubic spline (CIE 167:2005)"


@cache
def _observer(illuminant: str, space: str) -> tuple[Float64Array, Float64Array, Float64Array]:
    """(weights (waves, 3) that turn a spectrum into XYZ, matrix from there to `space`, XYZ of the white)."""
    try:
        with np.printoptions():  # the library sets numpy's for the whole process, and pictures' ids are made of text
            import colour
    except ImportError as error:
        raise missing_extra("colour-science", "colour", "colours of spectra") from error
    known: Any = colour.SDS_ILLUMINANTS
    if illuminant not in known:
        listed = ", ".join(sorted(known))
        raise UnknownNameError(
            "unknown_illuminant",
            f"no illuminant {str(illuminant)[:40]!r}; known: {listed}",
            where="illuminant",
            got=str(illuminant)[:40],
            expected=listed,
        )
    lamp, eye = known[illuminant], colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    power = np.interp(_WAVES, lamp.wavelengths, lamp.values, left=0.0, right=0.0)
    seen = np.stack([np.interp(_WAVES, eye.wavelengths, eye.values[:, k]) for k in range(3)], axis=1)
    weights = power[:, None] * seen
    weights /= weights[:, 1].sum()
    white = weights.sum(axis=0)
    if space == "XYZ":
        return weights, np.eye(3), white
    srgb: Any = colour.RGB_COLOURSPACES["sRGB"]
    target = np.asarray(colour.xy_to_XYZ(srgb.whitepoint))
    adapted = np.asarray(colour.adaptation.matrix_chromatic_adaptation_VonKries(white, target, transform="Bradford"))
    to_rgb_matrix = np.linalg.inv(np.asarray(srgb.matrix_RGB_to_XYZ)) @ adapted
    # the published matrix is rounded to four digits: white becomes exactly (1, 1, 1)
    to_rgb_matrix /= (to_rgb_matrix @ white)[:, None]
    return weights, np.asarray(to_rgb_matrix.T), white
