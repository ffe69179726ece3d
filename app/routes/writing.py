"""Materials stored and deleted over HTTP: a model by its parameters, a file of any format as it is."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from anyio.to_thread import run_sync
from brdf_service.http.bodies import in_time, pieces, read_json_body
from brdf_service.http.caching import etag_of_material
from brdf_service.http.errors import MediaTypeError
from brdf_service.http.json import model_from_json, to_json, validated
from brdf_service.http.openapi import content_of, route
from brdf_service.http.query import JsonObject, NoQuery, Query
from brdf_service.http.security import check_write
from brdf_service.library.writing import Condition, check_name
from brdf_service.routes.address import BY_NAME
from brdf_service.routes.jobs import ACCEPTED, accepted, new_job
from brdf_service.routes.materials import with_links
from brdf_service.schemas.materials import MaterialLine
from brdf_service.schemas.work import JobAnswer, MaterialModel, TabulateOptions
from brdf_service.settings import Settings
from brdf_service.state import State, state_of
from fastapi import APIRouter
from pydantic import Field
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

#: Far above any list of parameters.
_MOST_BYTES = 1_000_000
_EXAMPLE = '{"model": "cook_torrance", "parameters": {"roughness": 0.2, "ior": "gold"}}'
_HDF5 = b"\x89HDF\r\n\x1a\n"
_REFUSALS = (401, 403, 408, 409, 412, 413, 503)
_STORED = ("ETag", "Location")


class UploadQuery(Query):
    """How the file is read, and what becomes of it."""

    format: str | None = Field(
        None,
        description="format of the file; default: what its content says",
        pattern=f"^({'|'.join(bc.formats())})$",
        json_schema_extra={"enum": list(bc.formats())},
    )
    options: JsonObject | None = Field(
        None,
        description='options of the format\'s reader as a JSON object, for example {"negatives":"zero"}',
        examples=['{"negatives":"zero"}'],
    )
    tabulate: JsonObject | None = Field(
        None,
        description="tabulate what was read, with these options, as a JSON object; default: the table that the file "
        "holds, if it holds one",
        examples=['{"tolerance":0.01}'],
    )


router = APIRouter(tags=["materials"])


@route(
    router,
    f"PUT {BY_NAME.prefix}",
    "put_material",
    "store a model under a name",
    "Evaluated exactly, unless `tabulate` asks for a table: then 202 and a job. To replace a material send "
    "If-Match with its ETag, or *.",
    answer=(MaterialLine,),
    says="replaced",
    refusals=(400, 415, *_REFUSALS),
    parameters=[BY_NAME.parameter],
    body=(MaterialModel,),
    conditions=True,
    more={
        201: {
            "description": "stored",
            "content": content_of(MaterialLine),
            "headers": {name: {"schema": {"type": "string"}} for name in _STORED},
        },
        **ACCEPTED,
    },
)
async def put(request: Request, _: NoQuery) -> Response:
    state, name, condition = _writer(request)
    body = await read_json_body(request, _MOST_BYTES, state.settings.body_seconds)
    asked = model_from_json(body, MaterialModel, _EXAMPLE)
    model = await run_sync(_make, asked)
    if asked.tabulate is None:
        return await run_sync(_put_model, state, name, model, condition)
    options = asked.tabulate.model_dump(exclude_unset=True)
    _check_table(options, len(model.channels), state.settings)
    async with new_job(state, "tabulate", name, condition) as job:
        await run_sync(state.writer.check, name, condition)
        await run_sync(state.jobs.submit, job, {"model": asked.described, "about": asked.about, "tabulate": options})
    return accepted(state, job)


@route(
    router,
    f"POST {BY_NAME.prefix}/upload",
    "upload_material",
    "store a file under a name",
    "The body is the file, of any registered format. It is read by a process of its own, as a job; its table is "
    "stored as it is, anything else is tabulated, and a model file stays a model. To replace a material send "
    "If-Match with its ETag, or *.",
    status=202,
    answer=(JobAnswer,),
    refusals=(415, *_REFUSALS),
    parameters=[BY_NAME.parameter],
    query=UploadQuery,
    body=("application/octet-stream",),
    conditions=True,
    more=ACCEPTED,
)
async def upload(request: Request, asked: UploadQuery) -> Response:
    state, name, condition = _writer(request)
    settings = state.settings
    options: dict[str, Any] | None = None
    if asked.tabulate is not None:
        options = validated(asked.tabulate, TabulateOptions, "tabulate.").model_dump(exclude_unset=True)
        _check_table(options, 1, settings)
    await run_sync(state.writer.check, name, condition)
    async with new_job(state, "upload", name, condition) as job:
        path = job.folder / name  # the readers tell the file by this name
        try:
            await in_time(_receive(request, path, settings.max_upload_bytes), settings.upload_seconds)
        except OSError as error:
            raise state.writer.store.failed(error) from error
        await run_sync(_check_file, path, asked.format, asked.options or {}, settings)
        reading = {"input": str(path), "format": asked.format, "options": asked.options or {}}
        await run_sync(state.jobs.submit, job, {**reading, "tabulate": options})
    return accepted(state, job)


@route(
    router,
    f"DELETE {BY_NAME.prefix}",
    "delete_material",
    "delete a material",
    "Takes If-Match with its ETag, or *.",
    status=204,
    says="deleted",
    refusals=(404, *_REFUSALS),
    parameters=[BY_NAME.parameter],
    conditions=True,
)
async def delete(request: Request, _: NoQuery) -> Response:
    state, name, condition = _writer(request)
    await run_sync(state.writer.delete, name, condition)
    return Response(status_code=204)


def _writer(request: Request) -> tuple[State, str, Condition]:
    """Who writes what on which condition; whether it may is checked before the body is read."""
    state, name = state_of(request), request.path_params["name"]
    check_write(state.settings, request.headers)
    check_name(name)
    return state, name, Condition.of(request.headers)


async def _receive(request: Request, path: Path, limit: int) -> None:
    with path.open("xb") as file:  # nothing of it is kept in memory
        async for piece in pieces(request, limit, held=False):
            await run_sync(file.write, piece)


def _put_model(state: State, name: str, model: bc.Brdf, condition: Condition) -> Response:
    material, replaced = state.writer.put_model(name, model, condition)
    headers = {"etag": etag_of_material(name, material.tag), "location": f"/v1/materials/{name}"}
    body = to_json(with_links(name, material.facts))
    return Response(body, 200 if replaced else 201, headers, media_type="application/json")


def _make(asked: MaterialModel) -> bc.Brdf:
    if (asked.model is None) == (asked.sum is None) or (asked.sum is not None and asked.parameters):
        said = f"model: expected a name with its parameters, or 'sum', a list of those, for example {_EXAMPLE}"
        raise bc.InputError("field_missing", said, where="model", expected="model or sum")
    try:
        model = bc.model_from_json(asked.described)
    except bc.BrdfError:
        raise
    except (TypeError, ValueError, ArithmeticError) as error:  # a value of a kind that no model thought of
        said = f"{asked.model or 'sum'}: the parameters cannot be used"
        raise bc.InputError("bad_parameter", said, where="parameters") from error
    if asked.about:
        model.metadata["about"] = asked.about
    return model


def _check_table(options: dict[str, Any], channels: int, settings: Settings) -> None:
    """`LimitError` if the table that is asked for is larger than the service makes."""
    shape, limit = options.get("shape"), settings.max_table_bytes
    size = 8 * channels * math.prod(shape) if shape else options.get("max_bytes") or 0
    if size > limit:
        said = f"the table would have {size} bytes; the limit is {limit}"
        raise bc.LimitError("table_too_large", said, where="tabulate", got=size, limit=limit)


def _check_file(path: Path, format: str | None, options: dict[str, Any], settings: Settings) -> None:
    """What a glance can refuse, before a process is started."""
    if path.stat().st_size == 0:
        raise bc.FileFormatError("empty_file", "the body is empty; it must be the file", where="body")
    if not settings.allow_hdf5 and (format == "table" or _is_hdf5(path)):
        raise MediaTypeError(
            "hdf5_refused",
            "HDF5 files are not taken by this service (setting BRDF_ALLOW_HDF5); put the file into the data folder, or "
            "upload the measurement that it was made from",
            where="body",
            got="HDF5",
            expected=", ".join(f for f in bc.formats() if f != "table"),
        )
    if format is None:
        bc.sniff(path, options)


def _is_hdf5(path: Path) -> bool:
    """True if an HDF5 library would take the file: its signature may stand at 0, 512, 1024, 2048, ..."""
    size, offset = path.stat().st_size, 0
    with path.open("rb") as file:
        while offset + len(_HDF5) <= size:
            file.seek(offset)
            if file.read(len(_HDF5)) == _HDF5:
                return True
            offset = max(512, 2 * offset)
    return False
