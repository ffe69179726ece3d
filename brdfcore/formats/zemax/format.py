"""Zemax tabular BSDF text files: read to a grid about the mirror direction, and written.

The format states f in coordinates about the mirror direction, which `tables.specular_grid` keeps, so that nothing is
resampled. Text and layout: `zemax_text`.
"""

from __future__ import annotations

import hashlib
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import FLAGS, Brdf
from brdfcore.base.channels import VALUE, Channels
from brdfcore.base.errors import InputError
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.formats.base.format import Format, LossWarning, read_bytes
from brdfcore.formats.base.one_channel import OneChannel
from brdfcore.formats.base.rotations import ISOTROPIC
from brdfcore.formats.zemax.checks import (
    check_azimuths,
    check_isotropic,
    check_normal,
    integrals,
    measured_limit,
    padding,
    tis_remarks,
)
from brdfcore.formats.zemax.text import ZemaxFile, bad, compose, parse
from brdfcore.metrics import measured_flags
from brdfcore.tables.base.mirror_coordinates import above_horizon, node_directions
from brdfcore.tables.specular_grid import GRAZING, SpecularGrid

Float64Array = npt.NDArray[np.float64]

#: Largest file read; a 4-D file with 37 rotations has 1.2 MB.
MAX_BYTES = 64_000_000
XYZ = Channels(("X", "Y", "Z"))
#: What is written of a material that was not read from such a file, degrees; distances densest at 0.
INCIDENCES = (0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0, 70.0, 74.0, 78.0, 81.0,
              84.0, 86.0, 88.0)  # fmt: skip
RADIALS = (0.0, 0.1, 0.2, 0.3, 0.45, 0.65, 0.9, 1.25, 1.7, 2.3, 3.0, 4.0, 5.0, 6.5, 8.0, 10.0, 12.0, 15.0, 18.0, 22.0,
           26.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0, 70.0, 75.0, 80.0, 85.0, 90.0, 100.0, 110.0, 120.0,
           130.0, 140.0, 150.0, 160.0, 170.0, 180.0)  # fmt: skip
AZIMUTH_STEP = 10.0
#: Digits of a value that is sampled, not measured.
_DIGITS = 7

_CONVENTIONS = {
    "value": "BSDF = f_r in 1/sr, without the cosine",
    "angles": "degrees",
    "AngleOfIncidence": "theta_i; by the format's note the angle of the mirror direction, which is the same",
    "ScatterRadial": "angle between the scattered direction and the mirror direction",
    "ScatterAzimuth": "about the mirror direction: 0 towards the normal, 180 towards the horizon, counter-clockwise "
    "seen from outside; 0 to 180 stands for both sides where Symmetry is PlaneSymmetrical",
    "TIS": "total integrated scatter of each angle of incidence as the file states it; kept, not used",
}


class ZemaxFormat(Format):
    """Zemax (Radiant) tabular BSDF, BRDF of isotropic surfaces, monochrome or XYZ.

    Read to a `SpecularGrid` that answers with the file's own values at its own directions. What the file pads with 0
    is no measurement: values below the horizon are left out, and so are zeros from the first zero of a row to its end
    (zeros="hole"), which are filled as `holes` says. Files whose sample rotations differ, or whose samples differ by
    azimuth at theta_i = 0, are refused with the evidence, or averaged on request (isotropic="mean"). One ScatterAzimuth
    is a lobe of revolution about the mirror direction; two are the plane of incidence only. Written with the angles of
    the file that was read, else with `INCIDENCES`, `RADIALS` and every 10 degrees of azimuth; of a spectral material
    one wavelength a file (channel=).
    """

    name = "zemax"
    SUMMARY = "Zemax tabular BSDF, text: isotropic BRDF about the mirror direction"
    REFERENCE = (
        'R. Rykowski, "BSDF Data Interchange File Format Specification", Radiant Imaging, 2008; '
        'today "Zemax Tabular BSDF data file format", Zemax knowledge base'
    )
    EXTENSIONS = (".bsdf",)
    PARAMETERS = (
        ISOTROPIC,
        Parameter(
            "zeros", "", "zeros at the end of a row: padding, or data", "hole", kind="choice", choices=("hole", "data")
        ),
        Parameter("holes", "", "what stands in a hole", "continue", kind="choice", choices=("continue", "zero")),
        Parameter("negatives", "", "what negative samples become", "keep", kind="choice", choices=("keep", "zero")),
    )
    WRITE_PARAMETERS = (
        Parameter("channel", "", "the one channel to write; not given: all, of X, Y, Z or one", None, kind="text"),
    )
    writable = True
    exact = False

    def can_write(self, brdf: Brdf) -> bool:
        return not brdf.has_delta and (len(brdf.channels) == 1 or brdf.channels == XYZ)

    def keeps_every_bit(self, brdf: Brdf) -> bool:
        return isinstance(brdf, SpecularGrid)

    def sniff(self, head: bytes) -> bool:
        rest = head.removeprefix(b"\xef\xbb\xbf").lstrip()
        while rest.startswith(b"#"):
            rest = rest.partition(b"\n")[2].lstrip()
        words = rest[:200].split(None, 2)
        return len(words) >= 2 and words[0] == b"Source" and words[1] == b"Measured"

    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file. `StorageError` if it can't be opened, `LimitError` above `MAX_BYTES`, `FileFormatError` naming
        file, field and byte offset if it is damaged, holds transmission, or is anisotropic."""
        given = resolve("format 'zemax'", self.PARAMETERS, options)
        data = read_bytes(path, MAX_BYTES)
        return _table(parse(data, path.name), path.name, data, given)

    def write(self, brdf: Brdf, path: Path, **options: Any) -> Brdf:
        """Write f_r at the directions of a grid; directions below the horizon and holes are 0, as is usual.

        `InputError` unless the material has one channel or X, Y, Z, or where it has a perfect mirror part.
        """
        channel = resolve("writing format 'zemax'", self.WRITE_PARAMETERS, options)["channel"]
        content = _content(brdf if channel is None else OneChannel(brdf, channel))
        again = write_file(path, compose(content), self.read)
        if not isinstance(brdf, SpecularGrid):
            shape = " x ".join(map(str, content.values.shape[2:]))
            warnings.warn(
                f"sampled at {shape} nodes of theta_i, azimuth and distance from the mirror, {_DIGITS} digits; at "
                "theta_i = 0 the mean over azimuth",
                LossWarning,
                stacklevel=2,
            )
        return again


def _table(content: ZemaxFile, file: str, data: bytes, given: dict[str, Any]) -> SpecularGrid:
    done: list[str] = []
    remarks: list[str] = []
    bilateral = content.symmetry == "PlaneSymmetrical"
    values = content.values  # (C, rotations, K, A, R)
    azimuths = content.azimuths
    check_azimuths(content, file, bilateral)
    if azimuths.size == 1:  # a lobe of revolution about the mirror direction
        remarks.append("one ScatterAzimuth: the samples are taken as a lobe of revolution about the mirror direction")
        bilateral, azimuths = True, np.array([0.0, 180.0])
        values = np.repeat(values, 2, axis=3)
    elif azimuths.size == 2 or (not bilateral and azimuths.tolist() == [0.0, 180.0, 360.0]):
        remarks.append("two ScatterAzimuths: measured in the plane of incidence only; all between is interpolated")
    content = replace(content, symmetry="PlaneSymmetrical" if bilateral else content.symmetry, azimuths=azimuths,
                      values=values)  # fmt: skip
    hole = padding(values) if given["zeros"] == "hole" else np.zeros(values.shape, np.bool_)
    if content.rotations.size > 1:
        done += check_isotropic(content, hole, file, given["isotropic"])
    elif content.symmetry == "Asymmetrical4D":
        remarks.append("one sample rotation of an Asymmetrical4D file: whether the sample is isotropic can't be told")
    with np.errstate(invalid="ignore"):
        count = (~hole).sum(axis=1)
        mean = np.where(hole, 0.0, values).sum(axis=1) / np.where(count, count, 1)
    mean = np.moveaxis(np.where(count > 0, mean, np.nan), 0, -1)  # (K, A, R, C)
    done += check_normal(content, mean, file, given["isotropic"])
    integral = integrals(content, mean)
    negative = (mean < 0).sum(axis=(0, 1, 2))
    if given["negatives"] == "zero" and negative.any():
        mean = np.where(mean < 0, 0.0, mean)
        done.append(f"{int(negative.sum())} negative samples set to zero, as asked")
    elif negative.any():
        remarks.append(f"{int(negative.sum())} of {mean.size} samples are negative; they are kept")
    axes = [np.radians(x) for x in (content.incidences, azimuths, content.radials)]
    axes[0][content.incidences == 90] = np.pi / 2
    above = above_horizon(*axes)
    if not bilateral and azimuths[-1] < 360:
        axes[1] = np.append(axes[1], 2 * np.pi)
        mean = np.concatenate([mean, mean[:, :1]], axis=1)
    elif not bilateral:
        difference = float(np.nanmax(np.abs(mean[:, 0] - mean[:, -1]), initial=0))
        if difference > 0:
            done.append(f"ScatterAzimuth 0 and 360, one direction, differ by up to {difference:.3g}/sr: averaged")
            mean[:, 0] = mean[:, -1] = 0.5 * (mean[:, 0] + mean[:, -1])
        axes[1][-1] = 2 * np.pi
    else:
        axes[1][-1] = np.pi
    channels = VALUE if content.content == "Monochrome" else XYZ
    try:
        table, changes = SpecularGrid.from_nodes(
            axes[0], axes[1], axes[2], mean, channels, bilateral=bilateral, holes=given["holes"]
        )
    except InputError as error:
        raise bad(file, "samples", content.offset, error.detail, "nothing but padding", "a value") from error
    found = measured_flags(table)
    for flag in FLAGS:
        setattr(table, flag, found[flag] if flag != "bilateral" else bilateral or found[flag])
    if not bilateral:
        table.bilateral = False  # the azimuth axis is a whole turn
    table.non_negative = bool((table.values >= 0).all())
    albedo = table.albedo(axes[0])
    remarks += tis_remarks(content, integral)
    # N/A is no number of JSON
    stated = [[x if np.isfinite(x) else None for x in row] for row in content.tis.mean(axis=1).tolist()]
    sha = hashlib.sha256(data).hexdigest()
    table.source = {"name": file, "format": "zemax", "sha256": sha}
    table.metadata = {
        "description": next(
            (c for c in content.comments if "ample" in c), content.comments[0] if content.comments else ""
        )[:200],
        "zemax": {
            "symmetry": content.symmetry if content.rotations.size == 1 else "Asymmetrical",
            "incidences": content.incidences.tolist(),
            "azimuths": azimuths.tolist(),
            "radials": content.radials.tolist(),
            "tis": stated,
            "comments": content.comments,
        },
    }
    zeros = (values == 0).sum(axis=(1, 2, 3, 4))
    inside = np.broadcast_to(above[None, None], values.shape)
    padded = int((hole & inside).sum())
    if padded:
        limit = measured_limit(content, hole, axes, above)
        done.insert(
            0, f"{padded} zeros at the end of rows, all of them {limit}, are padding and not measured: left out"
        )
    table.report = {
        "format": "zemax",
        "file": file,
        "sha256": sha,
        "bytes": len(data),
        "conventions": dict(_CONVENTIONS),
        "found": {
            "description": table.metadata["description"],
            "channels": channels.to_json(),
            "symmetry": content.symmetry,
            "samples": int(values[0].size),
            "samples above the horizon": int(inside[0].sum()),
            "resolution": {
                "SampleRotation": int(content.rotations.size),
                "AngleOfIncidence": int(content.incidences.size),
                "ScatterAzimuth": int(azimuths.size),
                "ScatterRadial": int(content.radials.size),
            },
            "theta_i": axes[0].tolist(),
            "angles covered": f"theta_i {content.incidences[0]:g} to {content.incidences[-1]:g} degrees",
            "negative": dict(zip(map(str, channels), map(int, negative))),
            "zero": dict(zip(map(str, channels), map(int, zeros))),
            "padding above the horizon": padded,
            "TIS as stated": stated,
            "integral of the samples": integral.tolist(),
            "albedo at these theta_i": albedo.T.tolist(),
        },
        "done": [*done, *changes],
        "warnings": remarks,
    }
    return table


def _content(brdf: Brdf) -> ZemaxFile:
    """What a file says of `brdf`."""
    if brdf.has_delta:
        raise InputError(
            "delta_not_held",
            "a Zemax file can't hold a perfect mirror part; write the regular part alone, or another format",
            where="brdf",
        )
    if len(brdf.channels) != 1 and brdf.channels != XYZ:
        raise InputError(
            "channels_not_held",
            f"a Zemax file holds one channel, or X, Y, Z; this material has {', '.join(map(str, brdf.channels)):.80}: "
            "pass channel= (in the shell --write channel=NAME) for one of them",
            where="brdf",
            got=brdf.channels.to_json(),
            expected="one channel, or X, Y, Z",
        )
    name = "Monochrome" if len(brdf.channels) == 1 else "XYZ"
    if isinstance(brdf, SpecularGrid):
        return _own(brdf, name)
    incidences, radials = np.array(INCIDENCES), np.array(RADIALS)
    azimuths = np.arange(0.0, (180.0 if brdf.bilateral else 360.0) + 1, AZIMUTH_STEP)
    axes = [np.radians(x) for x in (incidences, azimuths, radials)]
    above = above_horizon(*axes, inset=GRAZING)
    theta_i, theta_o, delta_phi = (x[above] for x in node_directions(*axes))
    values = np.zeros((len(brdf.channels), *above.shape))
    sampled = brdf.evaluate(theta_i, np.minimum(theta_o, np.pi / 2), delta_phi).astype(np.float64)
    values[:, above] = sampled.T
    # light from exactly above has no azimuth, and samples that vary with it are those of an anisotropic material: the
    # mean over the turn, by the trapezoidal rule
    turn = values[:, 0]
    values[:, 0] = ((turn[:, :-1] + turn[:, 1:]) / 2).mean(axis=1, keepdims=True)
    values[:, above] = [[float(f"{v:.{_DIGITS}g}") for v in column] for column in values[:, above]]
    albedo = brdf.albedo(axes[0])
    text = str(brdf.metadata.get("description", "")) or str(getattr(brdf, "source", {}).get("name", "")) or "BRDF"
    return ZemaxFile(
        "PlaneSymmetrical" if brdf.bilateral else "Asymmetrical", name, np.zeros(1), incidences, azimuths, radials,
        values[:, None], np.array([[[float(f"{v:.{_DIGITS}g}") for v in row]] for row in albedo.T]), [text[:200]],
    )  # fmt: skip


def _own(table: SpecularGrid, name: str) -> ZemaxFile:
    """A grid's own nodes, 0 where it has no value; angles, TIS and comments of the file that it was read from."""
    kept = table.metadata.get("zemax")
    if isinstance(kept, dict):
        incidences, azimuths, radials = (np.array(kept[k]) for k in ("incidences", "azimuths", "radials"))
        symmetry, comments = kept["symmetry"], list(kept["comments"])
        tis = np.array(kept["tis"], np.float64)  # None becomes NaN: N/A
    else:
        own = ~(table.filled > 0).all(axis=(1, 2))  # a slice that only stands in at theta_i = 0 is left out
        incidences, azimuths, radials = (
            np.round(np.degrees(x), 9) for x in (table.theta_i[own], table.azimuth, table.radial)
        )
        symmetry = "PlaneSymmetrical" if table.bilateral else "Asymmetrical"
        tis = np.array([[float(f"{v:.{_DIGITS}g}") for v in row] for row in table.albedo(table.theta_i[own]).T])
        comments = [str(table.metadata.get("description", "")) or str(table.source.get("name", "")) or "BRDF"]
    first = table.theta_i.size - incidences.size
    values = table.values[first:, : azimuths.size].copy()
    values[table.filled[first:, : azimuths.size] > 0] = 0.0
    return ZemaxFile(
        symmetry, name, np.zeros(1), incidences, azimuths, radials, np.moveaxis(values, -1, 0)[:, None], tis[:, None],
        comments,
    )  # fmt: skip
