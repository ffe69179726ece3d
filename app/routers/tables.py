"""Everything about a material by its id: the same answers as by name, for ever."""

from __future__ import annotations

from fastapi import APIRouter

from app.addressing import BY_ID_ADDRESS
from app.routers.materials import metadata_route
from app.routers.parts import PARTS

router = APIRouter()
for _part in (metadata_route, *PARTS):
    router.include_router(_part(BY_ID_ADDRESS))
