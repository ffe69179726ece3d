"""Every setting of the service: one field each, given as a flag, as a BRDF_* variable, or left at its default."""

from __future__ import annotations

import ipaddress
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, SecretStr, ValidationError, field_validator

import brdfcore as bc

MB = 1024 * 1024

#: Fields whose variable is not just BRDF_ + the field's name.
_VARIABLES = {"data": "BRDF_DATA_DIR"}


class Settings(BaseModel):
    """Immutable settings. `Settings.load` merges flags, environment and defaults, in this order of precedence."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    host: str = Field("127.0.0.1", description="address to listen on; anything but loopback is reachable by others")
    port: int = Field(8000, ge=0, le=65535, description="port to listen on; 0 takes a free one and prints it")
    data: Path = Field(Path("brdf-data"), description="folder of the materials: NAME.h5 tables and NAME.json models")
    starter: bool = Field(True, description="fill an empty data folder with the starter library")
    log_level: Literal["debug", "info", "warning", "error"] = Field("info", description="least severity that is logged")
    cache_bytes: int = Field(512 * MB, ge=0, description="bytes of tables kept loaded; the least recently used go")
    max_points: int = Field(1_000_000, ge=1, description="most points of one evaluate request")
    max_values: int = Field(4_000_000, ge=1, description="most values (points x channels) of one JSON answer")
    max_theta_i: int = Field(16, ge=1, description="most angles of incidence in one slice")
    max_work_seconds: float = Field(
        20, gt=0, description="most seconds of an analysis, as estimated from its channels before it begins"
    )
    max_lmax: int = Field(64, ge=1, le=256, description="largest degree of an expansion in spherical harmonics")
    max_body_bytes: int = Field(64 * MB, ge=1, description="most bytes of a request body, counted as received")
    max_held_bytes: int = Field(
        192 * MB, ge=1, description="most bytes of request bodies held at once, those that still arrive among them"
    )
    max_json_bytes: int = Field(
        2 * MB, ge=1, description="most bytes of a JSON body of angles or vectors; plain numbers take max_body_bytes"
    )
    head_seconds: float = Field(20, gt=0, description="seconds in which a request's line and headers must have arrived")
    send_seconds: float = Field(60, gt=0, description="seconds after which a client that takes nothing is cut off")
    body_seconds: float = Field(60, gt=0, description="seconds in which a request body must have arrived")
    max_upload_bytes: int = Field(256 * MB, ge=1, description="most bytes of an uploaded file, counted as received")
    upload_seconds: float = Field(600, gt=0, description="seconds in which an upload must have arrived")
    max_table_bytes: int = Field(512 * MB, ge=1, description="most bytes of a table that a request may make")
    job_seconds: int = Field(600, ge=1, description="processor seconds of one upload or tabulation")
    job_memory_bytes: int = Field(
        4096 * MB, ge=1024 * MB, description="address space of the process that reads an upload or tabulates"
    )
    allow_hdf5: bool = Field(False, description="take uploads of HDF5 table files; their library is large and in C")
    api_key: SecretStr | None = Field(
        None,
        min_length=8,
        description="key that writing takes (X-API-Key, or Authorization: Bearer); without it only loopback may write",
    )
    allowed_hosts: tuple[str, ...] = Field(
        (), description="comma-separated Host names to answer to; empty: loopback names on loopback, any name elsewhere"
    )
    drain_seconds: int = Field(10, ge=0, description="seconds that running requests get to finish after SIGTERM")

    @field_validator("allowed_hosts", mode="before")
    @classmethod
    def _split(cls, value: Any) -> Any:
        return tuple(h.strip().lower() for h in value.split(",") if h.strip()) if isinstance(value, str) else value

    @classmethod
    def load(cls, environment: Mapping[str, str] = os.environ, **flags: Any) -> Settings:
        """Settings from flags (None = not given), then BRDF_* variables, then defaults.

        Raises `InputError` that names the flag or the variable, what it holds and what it may hold.
        """
        # an empty variable counts as unset: that is how compose files and CI switch one off
        set_there = {name: value for name in cls.model_fields if (value := environment.get(variable_of(name)))}
        given = {name: value for name, value in flags.items() if value is not None}
        try:
            return cls(**{**set_there, **given})
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            name, expected = str(first["loc"][0]), first["msg"]
            where = f"--{name.replace('_', '-')}" if name in given else variable_of(name)
            got = "(secret)" if name == "api_key" else str(first["input"])[:80]
            said = f"{where} = {got!r}: {expected}"
            raise bc.InputError("bad_setting", said, where=where, got=got, expected=expected) from error

    @property
    def loopback(self) -> bool:
        """True if only this machine can reach the service."""
        return is_loopback(self.host.lower().strip("[]"))

    @property
    def writable(self) -> bool:
        """True if materials can be stored and deleted at all: on loopback, or with a key."""
        return self.loopback or self.api_key is not None


def is_loopback(name: str) -> bool:
    """True for localhost and the addresses by which a machine reaches itself."""
    try:
        return name == "localhost" or ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def variable_of(name: str) -> str:
    """Environment variable of a setting: "max_points" -> "BRDF_MAX_POINTS"."""
    return _VARIABLES.get(name, f"BRDF_{name.upper()}")


def setting_lines() -> list[tuple[str, str, str]]:
    """(variable, default, description) of every setting, for `--help` and the documentation."""
    return [
        (variable_of(name), _shown(field.default), field.description or "")
        for name, field in Settings.model_fields.items()
    ]


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return str(int(value))
    if value is None:
        return "none"
    return ",".join(value) if isinstance(value, tuple) else str(value)
