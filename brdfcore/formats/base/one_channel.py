"""One channel of a material, for formats that hold a single one."""

from __future__ import annotations

from brdfcore.base.brdf import FLAGS, Brdf
from brdfcore.base.channels import VALUE
from brdfcore.base.conventions import FloatArray


class OneChannel(Brdf):
    """The channel `channel` of `whole` as channel "value"; `UnknownNameError` if there is none."""

    def __init__(self, whole: Brdf, channel: str) -> None:
        super().__init__()
        self.whole, self.index = whole, whole.channels.find(channel)
        self.channels = VALUE
        for name in (*FLAGS, "has_delta", "metadata", "report"):
            setattr(self, name, getattr(whole, name))
        self.source = getattr(whole, "source", {})

    def _evaluate(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[:, 0] = self.whole.evaluate(theta_i, theta_o, delta_phi)[:, self.index]
        return True

    def _uncertainty(self, theta_i: FloatArray, theta_o: FloatArray, delta_phi: FloatArray, out: FloatArray) -> bool:
        out[:, 0] = self.whole.uncertainty(theta_i, theta_o, delta_phi)[:, self.index]
        return True
