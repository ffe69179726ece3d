"""What a material answers, by name and by id alike: one line adds a resource to both."""

from __future__ import annotations

from collections.abc import Callable

from fastapi import APIRouter

from app.addressing import Address
from app.routers.albedo import albedo_routes
from app.routers.checks import check_routes
from app.routers.evaluate import evaluate_routes
from app.routers.gloss import gloss_routes
from app.routers.harmonics import harmonics_routes
from app.routers.relight import relight_routes
from app.routers.report import report_routes
from app.routers.slices import slice_routes
from app.routers.sphere import sphere_routes

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
