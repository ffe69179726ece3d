"""A model and its parameters as a JSON file: `{"model": "cook_torrance", "parameters": {"roughness": 0.1}}`."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import Brdf, Scaled, Sum
from brdfcore.base.catalogue import model_from_json
from brdfcore.base.errors import BrdfError, FileFormatError, InputError, StorageError
from brdfcore.base.parameters import resolve
from brdfcore.formats.base.format import Format
from brdfcore.models.base.model import Model

#: Room for any parameters of `MAX_CHANNELS` channels; a larger file is something else.
MAX_BYTES = 8_000_000
_KEYS = {"model", "parameters", "factor", "about"}


class ModelFormat(Format):
    """JSON object with `model` (a registry name) and `parameters` (an object), or with `sum`, a list of such objects;
    optionally, `factor` (a number, or one a channel, that a model is multiplied by) and `about` (a sentence).

    Read to the model itself, evaluated exactly; never tabulated on the way.
    """

    name = "model"
    SUMMARY = "an analytic model and its parameters (JSON)"
    EXTENSIONS = (".json",)
    writable = True

    def sniff(self, head: bytes) -> bool:
        return head.lstrip()[:1] == b"{" and any(_own_key(head, key) for key in (b'"model"', b'"sum"'))

    def read(self, path: Path, **options: Any) -> Brdf:
        resolve("format 'model'", self.PARAMETERS, options)
        try:
            with path.open("rb") as file:
                raw = file.read(MAX_BYTES + 1)
        except OSError as error:
            raise StorageError("cannot_open", f"{path}: {error.strerror or error}", where=str(path)) from error
        if len(raw) > MAX_BYTES:
            raise _bad(path, f"a model file has at most {MAX_BYTES} bytes")
        try:
            content = json.loads(raw)
        except (ValueError, RecursionError) as error:
            raise _bad(path, f"not JSON ({error})", offset=getattr(error, "pos", 0)) from error
        if not isinstance(content, dict) or ("model" in content) == ("sum" in content):
            raise _bad(path, 'expected an object {"model": NAME, "parameters": {...}}, or {"sum": [those, ...]}')
        about = content.get("about", "")
        unknown = sorted(set(content) - (_KEYS if "model" in content else {"sum", "about"}))
        if unknown or not isinstance(about, str):
            raise _bad(path, f"expected 'model', an object 'parameters' and a text 'about'; unknown: {unknown!r:.100}")
        try:
            brdf = model_from_json(content)
        except BrdfError as error:
            context = {**error.context, "file": path.name}
            raise FileFormatError(error.code, f"{path.name}: {error.detail}", **context) from error
        if about:
            brdf.metadata["about"] = about
        brdf.report = {
            "format": self.name,
            "file": path.name,
            "sha256": hashlib.sha256(raw).hexdigest(),
            "bytes": len(raw),
            "conventions": {},
            "found": {key: content[key] for key in ("model", "parameters", "factor", "sum") if key in content},
            "done": [],
            "warnings": [],
        }
        return brdf

    def write(self, brdf: Brdf, path: Path, **options: Any) -> Brdf:
        terms = _terms(brdf)
        if terms is None:  # a table of a model carries its metadata, but answers differently
            raise InputError(
                "not_a_model",
                "only an analytic model, or a sum of them, can be written as a model file; save others as a table",
                where="brdf",
                got=type(brdf).__name__,
                expected="a model",
            )
        keys = terms[0] if len(terms) == 1 else {"sum": terms}
        if "about" in brdf.metadata:
            keys["about"] = brdf.metadata["about"]
        text = json.dumps(keys, indent=1, allow_nan=False) + "\n"
        return write_file(path, text.encode(), self.read)


def _terms(brdf: Brdf) -> list[dict[str, Any]] | None:
    """Name and parameters of a model, or of each model of a sum; None if it is anything else."""
    if isinstance(brdf, Sum):
        parts = [_terms(part) for part in brdf.parts]
        return None if any(p is None for p in parts) else [term for p in parts for term in p or ()]
    if isinstance(brdf, Scaled):
        inner = _terms(brdf.part)
        if inner is None or len(inner) > 1 or "factor" in inner[0]:
            return None
        return [{**inner[0], "factor": brdf.factor.tolist() if brdf.factor.size > 1 else float(brdf.factor[0])}]
    if "fit" in brdf.metadata:  # a fitted model is its terms
        return [dict(term) for term in brdf.metadata["fit"]]
    return [{key: brdf.metadata[key] for key in ("model", "parameters")}] if isinstance(brdf, Model) else None


def _bad(path: Path, what: str, offset: int = 0) -> FileFormatError:
    return FileFormatError("bad_model_file", f"{path.name}: {what}", where=path.name, file=path.name, offset=offset)


def _own_key(head: bytes, key: bytes) -> bool:
    """Whether `key` stands in the outermost object: an instrument or a lamp may have a "model" too."""
    depth, at = 0, 0
    while at < len(head):
        c = head[at : at + 1]
        if c == b'"':
            if depth == 1 and head.startswith(key, at) and head[at + len(key) :].lstrip()[:1] == b":":
                return True
            at += 1
            while at < len(head) and head[at : at + 1] != b'"':
                at += 2 if head[at : at + 1] == b"\\" else 1
        elif c in b"{[":
            depth += 1
        elif c in b"}]":
            depth -= 1
        at += 1
    return False
