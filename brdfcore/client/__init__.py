"""The client of a service: `Client` and `AsyncClient`, whose materials are `Brdf`s evaluated elsewhere.

    from brdfcore.client import Client
    with Client("http://127.0.0.1:8000") as c:
        values = c.material("gold").evaluate(theta_i, theta_o, delta_phi)

Needs numpy and, once a name below is used, httpx2 (the extra `client`); nothing else of the library is loaded.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from brdfcore.base.errors import missing_extra

_PUBLIC = {
    "Client": "service",
    "Job": "jobs",
    "ReportJob": "jobs",
    "RemoteBrdf": "material",
    "AsyncClient": "service",
    "AsyncJob": "jobs",
    "AsyncReportJob": "jobs",
    "AsyncMaterial": "material",
    "ServiceError": "errors",
    "DeadlineError": "errors",
    "AccessError": "errors",
    "JobError": "errors",
}

if TYPE_CHECKING:  # the same names for type checkers, which would see Any through __getattr__
    from brdfcore.client.errors import AccessError as AccessError
    from brdfcore.client.errors import DeadlineError as DeadlineError
    from brdfcore.client.errors import JobError as JobError
    from brdfcore.client.errors import ServiceError as ServiceError
    from brdfcore.client.jobs import AsyncJob as AsyncJob
    from brdfcore.client.jobs import AsyncReportJob as AsyncReportJob
    from brdfcore.client.jobs import Job as Job
    from brdfcore.client.jobs import ReportJob as ReportJob
    from brdfcore.client.material import AsyncMaterial as AsyncMaterial
    from brdfcore.client.material import RemoteBrdf as RemoteBrdf
    from brdfcore.client.service import AsyncClient as AsyncClient
    from brdfcore.client.service import Client as Client

__all__ = list(_PUBLIC)


def __getattr__(name: str) -> Any:
    if name not in _PUBLIC:
        raise AttributeError(f"module 'brdfcore.client' has no attribute {name!r}")
    try:
        module = import_module(f"brdfcore.client.{_PUBLIC[name]}")
    except ModuleNotFoundError as error:
        if error.name is None or error.name.partition(".")[0] != "httpx2":
            raise
        raise missing_extra("httpx2", "client", "the client of a service") from error
    value = getattr(module, name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
