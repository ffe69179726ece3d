"""What the names of columns mean that the field agrees on: angles and their unit, wavelengths, the quantity."""

from __future__ import annotations

import re
from typing import NamedTuple

#: Names of angles, without blanks, underscores, hyphens and case. "dphi" and the like do not say where the mirror is.
_ANGLES = {
    "theta_i": ("thetai", "thetain", "thetainc", "thetaincident", "incidentangle", "incidenceangle",
                "angleofincidence", "aoi", "incidence", "incidentzenith", "zenithi", "zenithin"),
    "theta_o": ("thetao", "thetaout", "thetar", "thetav", "thetas", "thetascatter", "measureangle", "viewangle",
                "viewingangle", "observationangle", "scatterangle", "scatteringangle", "detectorangle",
                "angleofreflection", "reflectionangle", "aor", "viewzenith", "zenitho", "zenithout"),
    "phi_i": ("phii", "phiin", "phiinc", "phiincident", "incidentazimuth", "azimuthi", "azimuthin"),
    "phi_o": ("phio", "phiout", "phir", "phiv", "phis", "phiscatter", "viewazimuth", "azimutho", "azimuthout"),
    "delta_phi": ("deltaphi", "dphi", "relativeazimuth"),
    "theta_h": ("thetah", "thetahalf", "halfangle"),
    "theta_d": ("thetad", "thetadiff", "thetadifference", "differenceangle"),
    "phi_d": ("phid", "phidiff", "phidifference"),
    **{f"{w}_{k}": (f"{w}{k}", f"{w}.{k}", f"{o}{k}", f"{o[0]}{k}")
       for w, o in (("wi", "light"), ("wo", "view")) for k in "xyz"},
}  # fmt: skip
_ROLE = {name: role for role, names in _ANGLES.items() for name in names}
_QUANTITY = {"fr": "f", "brdf": "f", "bsdf": "f", "value": "f", "f": "f", "fcos": "f_cos", "brdfcos": "f_cos",
             "ccbrdf": "f_cos", "pif": "pi_f", "brf": "pi_f"}  # fmt: skip
_UNIT = re.compile(r"(.*?)[\s_]*(?:[\[(/,]\s*|_)(deg|degrees?|rad|radians?|1/sr|sr-1|sr\^-1|um|nm)\.?\s*[\])]?", re.I)
_WAVELENGTH = re.compile(r"(?:f_r_|brdf[ _]|f[ _])?(\d+(?:\.\d*)?|\.\d+)(e[-+]?\d+)?\s*(nm|um)", re.I)


#: Signs that people write in headers, and how these names are spelled here.
_SIGNS = {"°": "deg", "º": "deg", "θ": "theta", "ϑ": "theta", "Θ": "theta", "φ": "phi", "ϕ": "phi", "Φ": "phi",
          "λ": "lambda", "Δ": "d", "∆": "d", "µ": "u", "μ": "u", "⁻¹": "-1", "ᵢ": "i", "ₒ": "o", "ᵣ": "r",
          "−": "-", "\xa0": " "}  # fmt: skip


def spelled(line: str) -> str:
    """A line of a text file with Greek letters, degree and minus signs, as UTF-8 or Latin-1, spelled out."""
    if line.isascii():
        return line
    raw = line.encode("ascii", "surrogateescape")
    try:
        text = raw.decode()
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    for sign, name in _SIGNS.items():
        text = text.replace(sign, name)
    return text.encode().decode("ascii", "surrogateescape")


class Name(NamedTuple):
    """role of the column, "" unknown, or "value"; unit "deg", "rad" or ""; quantity of a value column, or ""."""

    role: str
    unit: str = ""
    quantity: str = ""


def meaning(name: str) -> Name:
    """What a header's cell says."""
    found = _UNIT.fullmatch(name.strip())
    stem, unit = (found[1], found[2].lower()[:3]) if found else (name.strip(), "")
    plain = re.sub(r"[\s_\-]", "", stem).lower()
    if plain in _ROLE:
        return Name(_ROLE[plain], unit if unit in ("deg", "rad") else "")
    if plain in ("wavelength", "lambda", "wavelengthnm"):
        return Name("wavelength", unit)
    if wavelength(name) is not None or name.startswith("f_r_"):
        return Name("value", "", "f" if name.startswith("f_r_") else "")
    if plain in _QUANTITY:
        return Name("value", "", _QUANTITY[plain])
    return Name("")


def without_unit(name: str) -> str:
    """ "BRDF" of "BRDF, 1/sr" and "BRDF [1/sr]"; a name that says no unit as it is."""
    found = _UNIT.fullmatch(name.strip())
    return found[1] if found and found[1] and wavelength(name) is None else name


def wavelength(name: str) -> float | None:
    """Nanometres that a name says, as 550nm, 0.55 um or f_r_550nm."""
    found = _WAVELENGTH.fullmatch(name.strip())
    if found is None:
        return None
    return float(found[1] + (found[2] or "")) * (1000 if found[3].lower() == "um" else 1)


def wavelengths(names: list[str]) -> list[float] | None:
    """Nanometres of columns that are named by wavelengths, all of them: with a unit, or as bare numbers, which are
    nanometres from 100 on and micrometres from .1 to 30; None for other names."""
    found = [wavelength(name) for name in names]
    if all(w is not None for w in found):
        return [w for w in found if w is not None]
    if not all(re.fullmatch(r"\d*\.?\d+", name.strip()) for name in names):
        return None
    plain = [float(name) for name in names]
    if min(plain) >= 100:
        return plain
    return [1000 * w for w in plain] if min(plain) >= 0.1 and max(plain) <= 30 and len(plain) > 1 else None
