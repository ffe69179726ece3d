"""The console script `brdf`: runs a command and turns every failure into a line and an exit code.

Exit codes: 0 done; 1 a file, the machine or the installation stands in the way; 2 the command line or its input is
wrong; 3 a check failed (`brdf check`); 130 interrupted; 141 the reader of a pipe has gone. A failure is written to
stderr as "error: ..."; with --json as {"error": {"code": ..., "detail": ..., "context": ...}}, so that stdout holds
results only. `--debug`, anywhere on the line, shows the traceback.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from typing import Any, TextIO

from brdfcore.base.errors import BrdfError, FileFormatError, MissingExtraError, StorageError, missing_extra

USAGE, FAILED, INTERRUPTED, PIPE_CLOSED = 2, 1, 130, 141

#: Which extra brings a package that may be missing.
_EXTRAS = {
    **dict.fromkeys(("typer", "rich", "numba", "scipy", "h5py", "matplotlib"), "core"),
    "flip_evaluator": "flip",
    **dict.fromkeys(("fastapi", "uvicorn", "pydantic", "starlette"), "service"),
    "httpx2": "client",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command line (default: the process's own) and return its exit code; never raises for a user's mistake."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug, as_json = "--debug" in given, "--json" in given
    given = [word for word in given if word != "--debug"]
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")  # a terminal that can't show "±" gets "?", not a traceback
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        warnings.showwarning = _show_warning
        try:
            code = _run(given)
            sys.stdout.flush()
            return code
        except BrokenPipeError:
            # what is still buffered has no reader; the interpreter would complain about it at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return PIPE_CLOSED
        except KeyboardInterrupt:
            return INTERRUPTED
        except Exception as error:
            if debug:
                traceback.print_exc()
            return _fail(error, as_json)


def _run(arguments: list[str]) -> int:
    from brdfcore.cli.commands import app

    try:
        # standalone_mode=False: exceptions come here, exit codes as values
        result = app(args=arguments, prog_name="brdf", standalone_mode=False)
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else FAILED
    return result if isinstance(result, int) else 0


def _fail(error: Exception, as_json: bool) -> int:
    """Report `error` on stderr and return the exit code."""
    show = getattr(error, "show", None)
    if show is not None and hasattr(error, "exit_code"):  # the parser's own: usage, unknown option, bad value
        if as_json:
            _write_json("usage", str(error.format_message()), {})  # type: ignore[attr-defined]
        else:
            show()
        return int(error.exit_code)
    known = _as_brdf_error(error)
    if as_json:
        _write_json(known.code, known.detail, known.context)
    else:
        print(f"error: {known.detail}", file=sys.stderr)
        if "options" in known.context:
            file, options = known.context.get("file", "FILE"), known.context["options"]
            print(f"options stand behind the file's name, as in '{file}:{options}'", file=sys.stderr)
    return (
        FAILED if isinstance(known, (FileFormatError, StorageError, MissingExtraError)) or known is not error else USAGE
    )


def _as_brdf_error(error: Exception) -> BrdfError:
    if isinstance(error, BrdfError):
        return error
    if isinstance(error, ModuleNotFoundError):
        package = (error.name or "").partition(".")[0]
        if package in _EXTRAS:
            return missing_extra(package, _EXTRAS[package], "this command")
    if isinstance(error, OSError):
        where = f"{error.filename}: " if error.filename else ""
        return StorageError("storage", f"{where}{error.strerror or error}", where=str(error.filename))
    if isinstance(error, MemoryError):
        return BrdfError("out_of_memory", "not enough memory; ask for fewer nodes or points")
    return BrdfError(
        "internal",
        f"internal: {type(error).__name__}: {error}; this is a fault of the program, not yours: "
        "please report it with the output of the same command and --debug",
    )


def _write_json(code: str, detail: str, context: dict[str, Any]) -> None:
    print(json.dumps({"error": {"code": code, "detail": detail, "context": context}}, default=str), file=sys.stderr)


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    print(f"warning: {message}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
