"""Materials stored and deleted over HTTP: a model by its parameters, a file of any format as it is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from anyio.to_thread import run_sync
from brdf_service.evaluate.json_codec import load, to_json
from brdf_service.http.bodies import pieces, read_json_body
from brdf_service.http.caching import etag_of_material
from brdf_service.http.errors import MediaTypeError
from brdf_service.http.openapi import HEADERS, answers, parameters, ref
from brdf_service.http.query import QueryParameter, choice, json_object, parse_query
from brdf_service.http.security import check_write
from brdf_service.library.writing import Condition, check_name
from brdf_service.routes.addressing import BY_NAME_ADDRESS
from brdf_service.routes.jobs import ACCEPTED, accepted
from brdf_service.routes.materials import with_links
from brdf_service.schemas import MaterialLine, MaterialModel, TabulateOptions
from brdf_service.settings import Settings
from brdf_service.state import State, state_of
from fastapi import APIRouter
from pydantic import ValidationError
from starlette.requests import Request
from starlette.responses import Response

import brdfcore as bc

#: Far above any list of parameters.
MAX_MODEL_BYTES = 1_000_000
_EXAMPLE = '{"model": "cook_torrance", "parameters": {"roughness": 0.2, "ior": "gold"}}'
_HDF5 = b"\x89HDF\r\n\x1a\n"
_BYTES_A_VALUE = 8
_PREFIX = BY_NAME_ADDRESS.prefix
_STORED = {"application/json": {"schema": ref(MaterialLine)}}
_REFUSALS = (401, 403, 408, 409, 412, 413, 503)

UPLOAD_QUERY = (
    QueryParameter(
        "format",
        "format of the file; default: what its content says",
        choice(*bc.formats()),
        {"type": "string", "enum": list(bc.formats())},
        default=None,
    ),
    QueryParameter(
        "options",
        'options of the format\'s reader as a JSON object, for example {"negatives":"zero"}',
        json_object,
        default=None,
        example='{"negatives":"zero"}',
    ),
    QueryParameter(
        "tabulate",
        "tabulate what was read, with these options, as a JSON object; default: the table that the file holds, if it "
        "holds one",
        json_object,
        default=None,
        example='{"tolerance":0.01}',
    ),
)

router = APIRouter(tags=["materials"])


@router.put(
    _PREFIX,
    summary="store a model under a name",
    description="Evaluated exactly, unless `tabulate` asks for a table: then 202 and a job. To replace a material send "
    "If-Match with its ETag, or *.",
    operation_id="put_material",
    responses={
        **answers(_STORED, "replaced", (400, 415, *_REFUSALS), cached=False),
        201: {"description": "stored", "content": _STORED, "headers": HEADERS["stored"]},
        **ACCEPTED,
    },
    openapi_extra={
        **parameters((), [BY_NAME_ADDRESS.parameter], conditions=True),
        "requestBody": {"required": True, "content": {"application/json": {"schema": ref(MaterialModel)}}},
    },
)
async def put(request: Request) -> Response:
    state, name, condition = _writer(request, ())
    body = await read_json_body(request, MAX_MODEL_BYTES, state.settings.body_seconds)
    asked, options = _model(load(body, _EXAMPLE), state.settings)
    model = await run_sync(_make, asked)
    if options is None:
        return await run_sync(_put_model, state, name, model, condition)
    _check_table(options, len(model.channels), state.settings)
    job = await run_sync(state.jobs.start, "tabulate", name, condition)
    try:
        await run_sync(state.store.check, name, condition)
        state.jobs.submit(job, {**asked, "tabulate": options})
    except BaseException:
        state.jobs.drop(job)
        raise
    return accepted(state, job)


@router.post(
    f"{_PREFIX}/upload",
    summary="store a file under a name",
    description="The body is the file, of any registered format. It is read by a process of its own, as a job; its "
    "table is stored as it is, anything else is tabulated, and a model file stays a model. To replace a material send "
    "If-Match with its ETag, or *.",
    operation_id="upload_material",
    responses={
        202: ACCEPTED[202],
        **{k: v for k, v in answers({}, "", (415, *_REFUSALS), cached=False).items() if k != 200},
    },
    openapi_extra={
        **parameters(UPLOAD_QUERY, [BY_NAME_ADDRESS.parameter], conditions=True),
        "requestBody": {
            "required": True,
            "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
        },
    },
)
async def upload(request: Request) -> Response:
    state, name, condition = _writer(request, UPLOAD_QUERY)
    asked = parse_query(request.scope["query_string"], UPLOAD_QUERY)
    options = None if asked["tabulate"] is None else _options(asked["tabulate"], state.settings)
    await run_sync(state.store.check, name, condition)
    job = await run_sync(state.jobs.start, "upload", name, condition)
    try:
        path = job.folder / name  # the readers tell the file by this name
        await _receive(request, path, state.settings)
        await run_sync(_check_file, path, asked["format"], state.settings)
        task = {
            "input": str(path),
            "format": asked["format"],
            "options": asked["options"] or {},
            "tabulate": options,
        }
        state.jobs.submit(job, task)
    except BaseException:
        state.jobs.drop(job)
        raise
    return accepted(state, job)


@router.delete(
    _PREFIX,
    summary="delete a material",
    description="Takes If-Match with its ETag, or *.",
    operation_id="delete_material",
    responses={
        204: {"description": "deleted"},
        **{k: v for k, v in answers({}, "", (404, *_REFUSALS), cached=False).items() if k != 200},
    },
    openapi_extra=parameters((), [BY_NAME_ADDRESS.parameter], conditions=True),
)
async def delete(request: Request) -> Response:
    state, name, condition = _writer(request, ())
    await run_sync(state.store.delete, name, condition)
    return Response(status_code=204)


def _writer(request: Request, query: tuple[QueryParameter, ...]) -> tuple[State, str, Condition]:
    """Who writes what on which condition; whether it may is checked before anything of the body is read."""
    state, name = state_of(request), request.path_params["name"]
    check_write(state.settings, request.headers)
    parse_query(request.scope["query_string"], query)
    check_name(name)
    return state, name, Condition.of(request.headers)


def _put_model(state: State, name: str, model: bc.Brdf, condition: Condition) -> Response:
    replaced = state.store.put_model(name, model, condition)
    material = state.library.get(name)
    headers = {"etag": etag_of_material(name, material.tag), "location": f"/v1/materials/{name}"}
    body = to_json(with_links(name, material.facts))
    return Response(body, 200 if replaced else 201, headers, media_type="application/json")


def _model(content: Any, settings: Settings) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """({model, parameters, about}, options of tabulate) of a PUT's body."""
    try:
        asked = MaterialModel.model_validate(content, strict=True)
    except ValidationError as error:
        raise explained(error) from error
    options = None if asked.tabulate is None else _options(asked.tabulate.model_dump(exclude_unset=True), settings)
    return {"model": asked.model, "parameters": asked.parameters, "about": asked.about}, options


def _make(asked: dict[str, Any]) -> bc.Brdf:
    if "name" in asked["parameters"]:  # would collide with the name of the model
        raise bc.UnknownNameError("unknown_parameter", "no model has a parameter 'name'", where="name")
    try:
        model = bc.model(asked["model"], **asked["parameters"])
    except bc.BrdfError:
        raise
    except (TypeError, ValueError, ArithmeticError) as error:  # a value of a kind that no model thought of
        raise bc.InputError(
            "bad_parameter", f"{asked['model'][:80]}: the parameters cannot be used", where="parameters"
        ) from error
    if asked["about"]:
        model.metadata["about"] = asked["about"]
    return model


def _options(given: dict[str, Any], settings: Settings) -> dict[str, Any]:
    """Options of tabulate, of the right types and sizes."""
    try:
        options = TabulateOptions.model_validate_json(json.dumps(given), strict=True).model_dump(exclude_unset=True)
    except ValidationError as error:
        raise explained(error, "tabulate.") from error
    if "shape" in options and options["shape"] is not None:
        _check_table(options, 1, settings)
    return options


def _check_table(options: dict[str, Any], channels: int, settings: Settings) -> None:
    """`LimitError` if the table that is asked for is larger than the service makes."""
    size = options.get("max_bytes") or 0
    if options.get("shape"):
        size = channels * _BYTES_A_VALUE
        for n in options["shape"]:
            size *= n
    if size > settings.max_table_bytes:
        raise bc.LimitError(
            "table_too_large",
            f"the table would have {size} bytes; the limit is {settings.max_table_bytes}",
            where="tabulate",
            got=size,
            limit=settings.max_table_bytes,
        )


def explained(error: ValidationError, where: str = "") -> bc.InputError:
    """The first complaint about a body as an error of ours."""
    first = error.errors(include_url=False, include_context=False)[0]
    place = where + ".".join(str(part)[:40] for part in first["loc"]) or "body"
    got, said = first["input"], first["msg"].removeprefix("Value error, ")  # the prefix of our own validators' words
    return bc.InputError(
        "bad_field",
        f"{place[:100]}: {said}",
        where=place[:100],
        got=got if isinstance(got, (str, bool, int, float)) else type(got).__name__,
        expected=said,
    )


async def _receive(request: Request, path: Path, settings: Settings) -> None:
    """The body into a file; nothing of it is kept in memory."""
    with path.open("xb") as file:
        async for piece in pieces(request, settings.max_upload_bytes, settings.upload_seconds):
            await run_sync(file.write, piece)


def _check_file(path: Path, format: str | None, settings: Settings) -> None:
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
        bc.sniff(path)


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
