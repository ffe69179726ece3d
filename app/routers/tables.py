"""Everything about a material by its id: the same answers as by name, for ever."""

from __future__ import annotations

from fastapi import APIRouter

from app.addressing import BY_ID_ADDRESS
from app.routers.albedo import albedo_routes
from app.routers.checks import check_routes
from app.routers.evaluate import evaluate_routes
from app.routers.gloss import gloss_routes
from app.routers.materials import metadata_route
from app.routers.report import report_routes
from app.routers.slices import slice_routes

router = APIRouter()
for _part in (metadata_route, evaluate_routes, slice_routes, albedo_routes, check_routes, gloss_routes, report_routes):
    router.include_router(_part(BY_ID_ADDRESS))
