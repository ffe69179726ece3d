"""What the library says of a material as numbers: one declaration each."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from brdf_service.evaluate.directions import check_incidences, check_values, polar_angles
from brdf_service.http.query import ANGLES, Numbers, Query, Unit, numbers
from brdf_service.library.materials import Material
from brdf_service.routes.address import Found
from brdf_service.routes.resource import Resource
from brdf_service.schemas.analysis import AlbedoAnswer, ChecksAnswer, FitAnswer, GlossAnswer
from brdf_service.state import State
from pydantic import Field

import brdfcore as bc


class AlbedoQuery(Query):
    """Angles of incidence."""

    theta_i: Numbers = numbers("polar angle(s) of the light, from the normal", example="0,30,60")
    angles: Unit = ANGLES


class ChecksQuery(Query):
    """Unit of the worst directions."""

    angles: Unit = ANGLES


class FitQuery(Query):
    """Which model."""

    model: Literal["auto", "ggx", "cook_torrance", "ward", "phong", "blinn_phong"] = Field(
        "ggx", description="model of the lobes; auto takes several times as long"
    )
    lobes: Literal["auto", "0", "1", "2", "3"] = Field("1", description="specular lobes on the diffuse base")
    loss: Literal["auto", "energy", "relative", "cube_root", "log"] = Field("auto", description="what is made small")
    base: Literal["lambert", "oren_nayar"] = Field("lambert", description="the diffuse part")


def _albedo(material: Material, asked: AlbedoQuery) -> dict[str, Any]:
    brdf, theta_i = material.brdf, polar_angles(asked.theta_i, asked.angles).radians()[0]
    values, delta = brdf.albedo(theta_i), brdf.delta_reflectance(theta_i)
    return {
        "theta_i": np.atleast_1d(asked.theta_i),
        "angles": asked.angles,
        "values": values.reshape(-1, values.shape[-1]),
        "delta_reflectance": delta.reshape(-1, delta.shape[-1]),
        "channels": brdf.channels.to_json(),
        "id": material.id,
        "has_delta": bool(brdf.has_delta),
    }


def _check_albedo(state: State, asked: AlbedoQuery, found: Found) -> None:
    check_values(asked.theta_i.size * len(found.material.brdf.channels), state.settings)


def _checks(material: Material, asked: ChecksQuery) -> dict[str, Any]:
    # found once for both units: it takes the library a second
    report = material.parts.get("checks")
    if report is None:
        report = material.parts["checks"] = bc.check(material.brdf)
    return {**report.to_json(asked.angles), "id": material.id}


def _gloss(material: Material, _: Query) -> dict[str, Any]:
    return {**bc.gloss(material.brdf).to_json(), "id": material.id}


def _fit(material: Material, asked: FitQuery) -> dict[str, Any]:
    lobes = asked.lobes if asked.lobes == "auto" else int(asked.lobes)
    found = bc.fit(material.brdf, asked.model, lobes, asked.loss, base=asked.base)
    return {**found.to_json(), "id": material.id}


def _fit_seconds(channels: int, asked: FitQuery) -> float:
    lobes = 3 if asked.lobes == "auto" else int(asked.lobes)
    return 0.3 * channels * (1 + lobes) * (1.5 if asked.model == "auto" else 1.0)


def _arrays(material: Material, _: Query) -> bytes:
    return bc.array_bytes(material.brdf)


def _report(material: Material, _: Query) -> dict[str, Any]:
    return {"name": material.name, "id": material.id, "report": material.brdf.report}


ANALYSES = (
    Resource(
        "checks",
        "energy, reciprocity, sign, symmetry, normal and horizon",
        ChecksQuery,
        ChecksAnswer,
        "Each finding in albedo units (misplaced reflectance), with its error, a verdict, what the material declares "
        "of itself, and the worst directions. Takes a second or more the first time.",
        "the findings",
        compute=_checks,
        seconds=lambda channels, _: 0.02 * channels,
        example="",
        title="energy, reciprocity, sign",
    ),
    Resource(
        "gloss",
        "gloss at 20, 60 and 85 degrees, and haze",
        content=GlossAnswer,
        description="Gloss units over the apertures of ISO 2813 / ASTM D523, haze after ASTM D4039 and E430, by "
        "channel and as a luminance, with the integration's error. Takes seconds the first time for a sharp material.",
        says="the readings",
        compute=_gloss,
        seconds=lambda channels, _: 0.01 * channels,
        kept=True,
        example="",
        title="gloss",
    ),
    Resource(
        "fit",
        "the analytic model nearest to it",
        FitQuery,
        FitAnswer,
        "A diffuse base and up to three lobes: terms as a model file has them, every parameter with its 95 % interval "
        "or the reason why it has none, and the share of the energy that the model misplaces. Takes seconds.",
        "the model and what it loses",
        compute=_fit,
        seconds=_fit_seconds,
        kept=True,
        example="model=ggx&lobes=1",
        title="nearest model",
    ),
    Resource(
        "albedo",
        "directional-hemispherical reflectance",
        AlbedoQuery,
        AlbedoAnswer,
        "The integral of f_r cos(theta_o) over all directions of the viewer, the mirror part included.",
        "values[theta_i][channel]",
        compute=_albedo,
        check=lambda state, asked: check_incidences(asked.theta_i, state.settings),
        check_found=_check_albedo,
        seconds=lambda channels, asked: 0.002 * channels * asked.theta_i.size,
        example="theta_i=0,30,60,80,89",
        title="albedo",
    ),
    Resource(
        "report",
        "what reading the source found and did",
        content={"application/json": {"schema": {"type": "object"}}},
        description="Counts of negative, zero and invalid values, conventions, policies, coverage, symmetries, albedo "
        "before and after, noise. Empty for a model.",
        says="the import report",
        compute=_report,
        seconds=lambda *_: 0.0,
        lasting=False,
        example="",
        title="how it was read",
    ),
    Resource(
        "arrays",
        "the nodes of a table, as shaders and other programs read them",
        description="A safetensors file: float32 arrays, halves and 16-bit words decoded, C order, little-endian; "
        "the metadata name representation, channels and settings. Of half_difference, lobe_grid, angle_grid and "
        "vndf_warp; another material is refused (422).",
        says="the file that `brdf export` writes beside a shader",
        compute=_arrays,
        seconds=lambda *_: 0.1,
    ),
)
