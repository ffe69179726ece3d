"""What a check found, in albedo units, and the page it is printed on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from brdfcore.base.channels import Channels

Verdict = Literal["pass", "note", "fail"]
AngleUnit = Literal["deg", "rad"]

_ANGLES = ("theta_i", "theta_o", "delta_phi")


@dataclass(frozen=True, slots=True)
class Worst:
    """Where a check found most. Angles in degrees; None: the finding is not about that angle."""

    theta_i: float | None
    theta_o: float | None
    delta_phi: float | None
    channel: str
    detail: str

    def __str__(self) -> str:
        angles = [f"{getattr(self, a):.4g}" for a in _ANGLES if getattr(self, a) is not None]
        return f"({', '.join(angles)}) {self.detail}"


@dataclass(frozen=True)
class Finding:
    """One check.

    value, error   misplaced reflectance of the worst channel, in albedo units: 0.01 is 1 % of the light that arrives
                   (energy: albedo - 1, negative where there is a margin), and the standard or quadrature error of it.
    by_channel     the value of each channel.
    relative       the same as a fraction of the light that is reflected, where that has a meaning.
    verdict        "pass": holds. "note": does not, within what measurements do, and nothing else is claimed.
                   "fail": past `fails_above`, or against what the entry declares.
    declared, found   what the entry says of itself, and what was found; None where it says nothing.
    fails_above, because   the threshold in albedo units, None where the amount is no fault, and why it is there.
    worst          the directions with the most, at most three, apart from each other.
    """

    name: str
    verdict: Verdict
    value: float
    error: float
    by_channel: list[float]
    relative: float | None
    declared: bool | None
    found: bool | None
    fails_above: float | None
    because: str
    says: str
    worst: list[Worst] = field(default_factory=list)

    def to_json(self, angles: AngleUnit = "deg") -> dict[str, Any]:
        """JSON-ready; what is not finite becomes null."""
        made = {k: _finite(v) for k, v in asdict(self).items()}
        if angles == "rad":
            for place in made["worst"]:
                place.update({a: math.radians(place[a]) for a in _ANGLES if place[a] is not None})
        return made


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, list):
        return [_finite(v) for v in value]
    return {k: _finite(v) for k, v in value.items()} if isinstance(value, dict) else value


@dataclass(frozen=True)
class CheckReport:
    """Every check of one material; `str()` is the page."""

    findings: list[Finding]
    channels: Channels
    albedo: float
    directions: int
    seed: int

    @property
    def verdict(self) -> Verdict:
        """The worst of all."""
        found = {f.verdict for f in self.findings}
        return "fail" if "fail" in found else "note" if "note" in found else "pass"

    @property
    def passed(self) -> bool:
        """Whether nothing failed."""
        return self.verdict != "fail"

    def __getitem__(self, name: str) -> Finding:
        return next(f for f in self.findings if f.name == name)

    def to_json(self, angles: AngleUnit = "deg") -> dict[str, Any]:
        """JSON-ready; `angles` is the unit of the worst directions."""
        return {
            "verdict": self.verdict,
            "unit": "albedo",
            "angles": angles,
            "channels": self.channels.to_json(),
            "albedo": _finite(self.albedo),
            "directions": self.directions,
            "seed": self.seed,
            "findings": [f.to_json(angles) for f in self.findings],
        }

    def lines(self) -> Iterator[tuple[str, str]]:
        """(text, style) of the page's lines; style is a verdict, "head" or ""."""
        count = {v: sum(f.verdict == v for f in self.findings) for v in ("pass", "note", "fail")}
        of_all = ", ".join(f"{n} {v}" for v, n in count.items() if n)
        labels = self.channels.labels()
        listed = ", ".join(labels) if len(labels) <= 8 else f"{labels[0]} ... {labels[-1]}, {len(labels)} in all"
        yield f"{of_all}; mean albedo {self.albedo:.4f}", self.verdict
        yield f"channels {listed}; {self.directions:,} random direction pairs, seed {self.seed}", ""
        yield "amounts are misplaced reflectance of the worst channel: 0.01 is 1 % of the light that arrives", ""
        yield "", ""
        yield f"{'check':<12} {'verdict':<8} {'amount':>20}  what was found", "head"
        for f in self.findings:
            amount = f"{f.value:+.2e}" if f.name == "energy" else f"{f.value:.2e}"
            yield f"{f.name:<12} {f.verdict:<8} {amount + f' ± {f.error:.0e}':>20}  {f.says}", f.verdict
            declared = [] if f.declared is None else [f"declared {'yes' if f.declared else 'no'}"]
            limit = [] if f.fails_above is None else [f"fails above {f.fails_above:g}"]
            why = [] if f.verdict == "pass" else [f.because]
            reason = [": ".join([*limit, *why])] if limit or why else []
            if declared or reason:
                yield f"{'':<14}{'; '.join([*declared, *reason])}", ""
            for place in f.worst:
                yield f"{'':<16}{place}", ""
        yield "", ""
        yield (
            "directions are (theta_i[, theta_o, delta_phi]), degrees; the mirror direction is at delta_phi = 180",
            "",
        )

    def __str__(self) -> str:
        return "\n".join(text for text, _ in self.lines())
