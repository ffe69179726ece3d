"""The live service against its own OpenAPI document: schemathesis, every check, single requests and sequences of them.

BRDF_SCHEMATHESIS_CASES sets the number of cases; a few hundred by default.
"""

from __future__ import annotations

import copy
import io
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

schemathesis = pytest.importorskip("schemathesis")

from brdf_service.main import create_app  # noqa: E402
from brdf_service.settings import Settings  # noqa: E402
from hypothesis import HealthCheck, Phase, settings  # noqa: E402
from hypothesis import strategies as st  # noqa: E402
from schemathesis.config import SchemathesisConfig  # noqa: E402

from tests.app.running import Running, running  # noqa: E402

CASES = int(os.environ.get("BRDF_SCHEMATHESIS_CASES", "300"))
STEPS = 8
NAMES = ["gold", "gold-grid", "red", "mirror", "new-1", "new-2"]


def _npy(values: list[float]) -> bytes:
    file = io.BytesIO()
    np.save(file, np.array(values[: len(values) // 3 * 3]).reshape(3, -1))
    return file.getvalue()


ANGLES = st.lists(st.floats(0, 1.5) | st.floats(), max_size=12)
NUMBERS = ANGLES.map(lambda values: np.array(values).tobytes()) | st.binary(max_size=100)
schemathesis.openapi.media_type("application/octet-stream", NUMBERS)
schemathesis.openapi.media_type("application/x-npy", ANGLES.map(_npy) | st.binary(max_size=100))


@schemathesis.serializer("application/x-npy")  # type: ignore[untyped-decorator, unused-ignore]
def as_it_is(ctx: Any, value: Any) -> Any:
    return value if isinstance(value, bytes) else str(value).encode("utf-8", "surrogatepass")


def _document() -> Any:
    """The service's own, with the names of its materials as likely values: random ones are all unknown."""
    document = copy.deepcopy(create_app(Settings(), warm=False).openapi())
    for operations in document["paths"].values():
        for operation in operations.values():
            for parameter in operation.get("parameters", []):
                if parameter["name"] == "name":
                    parameter["schema"] = {"anyOf": [{"enum": NAMES}, {"enum": NAMES}, parameter["schema"]]}
                if parameter["name"].startswith("theta"):
                    parameter["schema"] = {"anyOf": [{"enum": ["0", "30", "30,60"]}, {"type": "string"}]}
                if parameter["name"] == "delta_phi":
                    parameter["schema"] = {"anyOf": [{"enum": ["0", "180", "-7.5"]}, {"type": "string"}]}
                if parameter["name"] == "If-Match":
                    parameter["schema"] = {"anyOf": [{"enum": ["*"]}, {"type": "string"}]}
    return document


DOCUMENT = _document()
OPERATIONS = sum(len(methods) for methods in DOCUMENT["paths"].values())
#: What a schema cannot say: that lists must broadcast, that 95 degrees are past the horizon, that a model has no such
#: parameter, that a material exists, that HDF5 is not taken, or that bytes are a .npy file (400). Such a request is
#: well-formed and refused all the same.
_REFUSED_STATUSES = ["400", "401", "403", "404", "405", "406", "408", "409", "412", "413", "415", "422", "503"]
_ACCEPTED = ["2xx", "400", "401", "403", "404", "409", "412", "413", "415", "422", "503"]
_CONFIG = {
    "checks": {
        "positive_data_acceptance": {"expected-statuses": _ACCEPTED},
        # a condition is looked at before the body is
        "negative_data_rejection": {"expected-statuses": _REFUSED_STATUSES},
        # a full queue is said with a 503, and the cases here come faster than jobs end
        "not_a_server_error": {"expected-statuses": ["2xx", "3xx", "4xx", "503"]},
    },
    "headers": {"Host": "127.0.0.1"},
    # DELETE cancels a job; what became of it is told for an hour
    "operations": [{"include-operation-id": ["job", "job_events"], "checks": {"use_after_free": {"enabled": False}}}],
}
SCHEMA = schemathesis.openapi.from_dict(DOCUMENT, config=SchemathesisConfig.from_dict(_CONFIG))


def limits(cases: int, **more: int) -> settings:
    return settings(
        max_examples=max(1, cases),
        deadline=None,
        database=None,
        derandomize="BRDF_SCHEMATHESIS_CASES" not in os.environ,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
        **more,
    )


@pytest.fixture(scope="module")
def live(original: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    data = Path(shutil.copytree(original, tmp_path_factory.mktemp("live") / "data"))
    with running(data, "--log-level", "error", "--job-seconds", "5", "--max-table-bytes", "1MiB") as made:
        yield made
        _, errors = made.stop()
        assert "Traceback" not in errors


@SCHEMA.parametrize()
@limits(CASES // 2 // OPERATIONS)
def test_single_requests(case: schemathesis.Case, live: Running) -> None:
    case.call_and_validate(base_url=f"http://127.0.0.1:{live.port}")


def test_sequences(live: Running) -> None:
    base = SCHEMA.as_state_machine()

    class Sequences(base):  # type: ignore[misc, valid-type]
        def get_call_kwargs(self, case: schemathesis.Case) -> dict[str, str]:
            return {"base_url": f"http://127.0.0.1:{live.port}"}

    Sequences.run(settings=limits(CASES // 2 // STEPS, stateful_step_count=STEPS))
