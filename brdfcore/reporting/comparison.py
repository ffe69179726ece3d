"""`brdfcore.compare`: the error measures of a candidate, and on request what it costs and how it looks."""

from __future__ import annotations

from dataclasses import replace

from brdfcore.base.brdf import Brdf
from brdfcore.metrics import WHOLE, Comparison, Range
from brdfcore.metrics import compare as measures


def compare(
    reference: Brdf,
    candidate: Brdf,
    *,
    directions: int = 200_000,
    seed: int = 20_261_122,
    light: Range = WHOLE,
    view: Range = WHOLE,
    speed: bool = False,
    appearance: bool = False,
) -> Comparison:
    """Every measure of `candidate` against `reference`; `metrics.Comparison` names them, with formulas and sources.

    Parameters
    ----------
    directions, seed : int
        Draws the integrals are estimated on; a tenth of a second for the default number.
    light, view : (float, float)
        Ranges of theta_i and theta_o, radians, that the integrals go over.
    speed : bool
        Also `nbytes` and `ns`: {label: {best, median, high}} a look-up of the candidate by batch (1, 1000, 1000000 on
        one thread, and the last on all). Some seconds.
    appearance : bool
        Also `flip`: mean and 95th percentile of FLIP between a lit sphere of each. A second or two; needs the `flip`
        extra.

    Raises
    ------
    InputError
        The channels differ and neither is single; a number of directions, or a range, that cannot be.

    >>> grey, lighter = bc.model("lambert", reflectance=0.5), bc.model("lambert", reflectance=0.6)
    >>> found = bc.compare(grey, lighter)
    >>> round(found.l1, 6), round(found.rel_l2, 6)  # 0.1/0.5
    (0.2, 0.2)
    """
    found = measures(reference, candidate, directions=directions, seed=seed, light=light, view=view)
    if speed:
        from brdfcore.analysis.pareto.timing import look_up_maker, time_all

        times = time_all({"": look_up_maker(candidate)})[""]
        nbytes = int(getattr(candidate, "nbytes", 0))
        found = replace(found, nbytes=nbytes, ns={label: t.to_json() for label, t in times.items()})
    if appearance:
        from brdfcore.reporting.appearance import appearance as look

        found = replace(found, flip=look(reference, candidate).to_json())
    return found
