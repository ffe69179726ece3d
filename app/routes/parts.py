"""What a material answers, by name and by id alike: one line adds a resource to both."""

from __future__ import annotations

from collections.abc import Callable

from brdf_service.routes.addressing import Address
from brdf_service.routes.albedo import albedo_routes
from brdf_service.routes.checks import check_routes
from brdf_service.routes.evaluate import evaluate_routes
from brdf_service.routes.gloss import gloss_routes
from brdf_service.routes.harmonics import harmonics_routes
from brdf_service.routes.relight import relight_routes
from brdf_service.routes.report import report_routes
from brdf_service.routes.slices import slice_routes
from brdf_service.routes.sphere import sphere_routes
from fastapi import APIRouter

PARTS: tuple[Callable[[Address], APIRouter], ...] = (
    evaluate_routes,
    slice_routes,
    sphere_routes,
    albedo_routes,
    check_routes,
    gloss_routes,
    harmonics_routes,
    relight_routes,
    report_routes,
)
