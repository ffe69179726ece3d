"""Error measures between two BRDFs, and what data claims: each has a name, a formula and a source.

f is the reference, f' the candidate; all integrals are over pairs of directions of the upper hemisphere. `comparison`
puts the measures of `estimators` together; `symmetry` holds the defects and flags of one BRDF alone.
"""

from __future__ import annotations

from brdfcore.metrics.comparison import WHOLE, Comparison, Range, albedo_bias, albedo_excess, compare
from brdfcore.metrics.symmetry import (
    ALBEDO_SLACK,
    BIAS_ANGLES,
    FLAG_DEFECT,
    bilateral_defect,
    measured_flags,
    reciprocity_defect,
)

__all__ = [
    "ALBEDO_SLACK",
    "BIAS_ANGLES",
    "FLAG_DEFECT",
    "WHOLE",
    "Comparison",
    "Range",
    "albedo_bias",
    "albedo_excess",
    "bilateral_defect",
    "compare",
    "measured_flags",
    "reciprocity_defect",
]
