"""Where a material was measured: a disc of viewers for each angle of incidence, coloured by `status`."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch

from brdfcore.base.brdf import Brdf
from brdfcore.base.conventions import HALF_PI, check_domain, flatten_angles
from brdfcore.base.errors import InputError
from brdfcore.base.status import Status
from brdfcore.plot import style
from brdfcore.plot.canvas import canvas, footnotes, heading
from brdfcore.plot.rendering import drawing
from brdfcore.plot.style import FAINT, INK
from brdfcore.tables.scattered.table import Scattered

Array = npt.NDArray[np.float64]

#: Apart in grey too: lightness .5, .75, .93.
_COLOURS = {
    Status.MEASURED: "#4477AA",
    Status.SMOOTHED: "#CC6677",
    Status.INTERPOLATED: "#88AACC",
    Status.EXTRAPOLATED: "#EECC66",
    Status.FILLED: "#EEEEEE",
}
_WORDS = {
    Status.MEASURED: "the source's own value",
    Status.SMOOTHED: "smoothed: over 2 % from the source's",
    Status.INTERPOLATED: "interpolated",
    Status.EXTRAPOLATED: "extrapolated",
    Status.FILLED: "filled by a policy",
}
#: Angles of incidence drawn where none are asked for, and the most that are.
_DEFAULT = (0.0, 30.0, 60.0, 80.0)
MOST = 12
_PIXELS = 201
#: Measurements whose theta_i is farther than this from all discs, rad, are in none.
_NEAR = np.radians(5.0)


def coverage(
    b: Brdf,
    theta_i: npt.ArrayLike | None = None,
    *,
    title: str | None = None,
    size: tuple[float, float] | None = None,
    dpi: float = 150,
) -> Figure:
    """Which viewers were measured for each theta_i: discs as in `hemisphere`, coloured by `Brdf.status`.

    Dots are the measured geometries of a `scattered` table, each in the disc with the nearest theta_i, if that is
    within 5 degrees.

    theta_i  radians, 1 to `MOST` of them; None: those of the measurements, or 0, 30, 60 and 80 degrees.
    """
    points = b.angles if isinstance(b, Scattered) else np.zeros((0, 3))
    lights = _lights(points) if theta_i is None else np.atleast_1d(np.asarray(theta_i, np.float64)).reshape(-1)
    if not 1 <= lights.size <= MOST:
        raise InputError(
            "wrong_number",
            f"theta_i: {lights.size} angles; the picture has room for 1 to {MOST}",
            where="theta_i",
            got=int(lights.size),
            expected=f"1 to {MOST}",
        )
    check_domain(flatten_angles(lights, 0.0, 0.0))
    lights = np.unique(lights)
    columns = min(lights.size, 4)
    rows = -(-lights.size // columns)
    if size is None:
        room = min(2.1, 3.9 / columns if columns < 3 else 2.0)
        size = (max(4.6, 0.5 + room * columns), 1.55 + room + (rows - 1) * (room + 0.22))
    with drawing():
        figure, axes = canvas(size, dpi)
        room = min((size[0] - 0.4) / columns, (size[1] - 1.55 + 0.22) / rows - 0.22)
        radius = max(0.5 * room - 0.1, 0.2)
        apart = np.abs(points[:, :1] - lights)
        owner = np.where(apart.min(axis=1) <= _NEAR, apart.argmin(axis=1), -1)
        seen = set()
        for k, light in enumerate(lights):
            row, column = divmod(k, columns)
            centre = (
                size[0] / 2 + (column - (min(columns, lights.size - row * columns) - 1) / 2) * (room + 0.02),
                size[1] - 0.85 - radius - row * (room + 0.22),
            )
            seen |= _disc(axes, b, float(light), points[owner == k], centre, radius)
        mirror = Line2D([], [], marker="o", ms=8, mfc="none", mec=INK, ls="none", label="mirror direction")
        handles: list[Artist] = [mirror]
        if len(points):
            handles.append(Line2D([], [], marker="o", ms=3, color="black", ls="none", label="measured"))
        handles += [
            Patch(fc=_COLOURS[s], ec=FAINT, lw=0.5, label=_WORDS[s])
            for s in _COLOURS
            if s in seen and not (len(points) and s is Status.MEASURED)
        ]
        figure.legend(
            handles=handles, loc="lower center", ncols=min(len(handles), 3 if columns < 3 else 6), frameon=False,
            fontsize=8, bbox_to_anchor=(0.5, 0.22 / size[1]), borderaxespad=0.0, handletextpad=0.4, columnspacing=1.2,
        )  # fmt: skip
        heading(axes, size, title if title is not None else style.name_of(b), "viewers, for each angle of the light θᵢ")
        footnotes(axes, ["radius θₒ, rim 90°, rings 30° and 60°; mirror side (Δφ = 180°) right, light from the left"])
    return figure


def _lights(points: Array) -> Array:
    """The measured angles of incidence, or evenly chosen ones of them."""
    if not len(points):
        return np.radians(_DEFAULT)
    # angles a tenth of a degree apart are one setting of a goniometer
    levels = np.unique(np.round(np.degrees(points[:, 0]), 1))
    if levels.size > 8:
        levels = levels[np.unique(np.linspace(0, levels.size - 1, 8).round().astype(int))]
    return np.radians(levels)


def _disc(axes: Axes, b: Brdf, light: float, points: Array, centre: tuple[float, float], radius: float) -> set[Status]:
    """One disc; which statuses it shows."""
    across = np.linspace(-1, 1, _PIXELS)
    x, y = np.meshgrid(across, across)
    theta = np.hypot(x, y) * HALF_PI
    inside = theta <= HALF_PI
    codes = np.full(x.shape, np.nan)
    # the mirror side is to the right: delta_phi = pi at x > 0
    codes[inside] = b.status(light, theta[inside], np.arctan2(-y[inside], -x[inside]))
    shades = [_COLOURS.get(s, "white") for s in Status]
    colours, norm = ListedColormap(shades), BoundaryNorm(np.arange(-0.5, len(shades)), len(shades))
    extent = (centre[0] - radius, centre[0] + radius, centre[1] - radius, centre[1] + radius)
    image = axes.imshow(
        np.ma.masked_invalid(codes), cmap=colours, norm=norm, extent=extent,
        origin="lower", interpolation="nearest", aspect="auto", zorder=1,
    )  # fmt: skip
    image.set_clip_path(Circle(centre, radius, transform=axes.transData))
    for deg in (30, 60, 90):
        rim = deg == 90
        axes.add_patch(
            Circle(centre, radius * deg / 90, fill=False, ec=INK if rim else FAINT, lw=0.8 if rim else 0.4, zorder=2)
        )
    reach = radius * light / HALF_PI
    axes.add_line(
        Line2D([centre[0] + reach], [centre[1]], marker="o", ms=8, mfc="none", mec=INK, zorder=4, clip_on=False)
    )
    if len(points):
        r = radius * points[:, 1] / HALF_PI
        axes.plot(
            centre[0] - r * np.cos(points[:, 2]), centre[1] - r * np.sin(points[:, 2]),
            ls="none", marker="o", ms=1.3, mew=0, color="black", zorder=3,
        )  # fmt: skip
    shown = style.degrees_text(float(np.radians(np.round(np.degrees(light), 2))))
    count = f", {len(points)} measured" if len(points) else ""
    axes.text(centre[0], centre[1] + radius + 0.04, f"θᵢ = {shown}{count}", ha="center", va="bottom", fontsize=8)
    return {Status(int(c)) for c in np.unique(codes[inside])}
