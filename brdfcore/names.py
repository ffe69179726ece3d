"""Names of choices, each list in one place: types for checkers, and at run time `choices` of them.

    WINDOWS = choices(Window)  # ("none", "lanczos", "hann", "lanczos2")

Loads nothing. What a name means is where it is used: `harmonics.windows`, `harmonics.targets`, `plot.lighting`, ...
"""

from __future__ import annotations

from typing import Any, Literal, get_args

#: What is expanded in spherical harmonics: f_r times the cosines of both directions, f_r, f_r times that of the viewer.
Target = Literal["f_cos_cos", "f", "f_cos_o"]
#: Factors of an expansion's coefficients against ringing.
Window = Literal["none", "lanczos", "hann", "lanczos2"]
#: What surrounds a lit sphere.
Lighting = Literal["studio", "sky"]
#: Which directions a slice holds: the plane of incidence, or all viewers.
View = Literal["polar", "hemisphere"]
#: Unit of angles that are given and printed.
AngleUnit = Literal["deg", "rad"]
#: Of the values of a picture.
Scale = Literal["linear", "log"]
#: Between the nodes of a table.
Interpolation = Literal["nearest", "linear", "monotone_cubic"]
#: Of pictures, and of a slice, whose numbers may be had too.
PictureFormat = Literal["png", "svg"]
SliceFormat = Literal["json", "csv", "png", "svg"]

#: A regular expression: what a material may be called.
MATERIAL_NAME = "[A-Za-z0-9][A-Za-z0-9._-]{0,63}"


def choices(kind: Any) -> tuple[str, ...]:
    """The names of one of the types above, in their order."""
    return get_args(kind)
