"""Everything about a material by its id: the same answers as by name, for ever."""

from __future__ import annotations

from brdf_service.routes.addressing import BY_ID_ADDRESS
from brdf_service.routes.materials import metadata_route
from brdf_service.routes.parts import PARTS
from fastapi import APIRouter

router = APIRouter()
for _part in (metadata_route, *PARTS):
    router.include_router(_part(BY_ID_ADDRESS))
