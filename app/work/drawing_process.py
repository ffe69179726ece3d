"""The process that draws: one picture after the other, until the service ends.

A task names a material (`name`, `id`, `file` as in `store.File`) and a `picture`, the fields of `Picture`. The answer
is {"bytes": n} and n bytes; {"problem": {...}}, an error of the library; {"failed": true}, any other, whose traceback
is on stderr; or {"changed": true}: the file does not hold that material any more.
"""

from __future__ import annotations

import contextlib
import traceback
from typing import Any

from brdf_service.work.subprocesses import Parent, told

import brdfcore as bc

#: Bytes of tables kept open, those of a page of pictures; and those that a model counts for, which has no arrays.
_TABLE_BYTES, _LEAST_BYTES = 64 * 2**20, 64 * 2**10


def main() -> None:
    """Draw what is asked for."""
    parent = Parent()  # before what takes a second to import, and may print
    from brdf_service.library.materials import Material, open_material
    from brdf_service.library.store import File
    from brdf_service.work.pictures import Picture, draw
    from cachetools import LRUCache

    held: LRUCache[str, Material] = LRUCache(_TABLE_BYTES, getsizeof=lambda m: max(m.nbytes, _LEAST_BYTES))

    def answer(task: dict[str, Any]) -> tuple[dict[str, Any], bytes]:
        material = held.get(task["id"])
        if material is None:
            with contextlib.suppress(Exception):  # a file that cannot be read has changed as well
                material = open_material(task["name"], File(*task["file"]))
            if material is None or material.id != task["id"]:
                return {"changed": True}, b""
            with contextlib.suppress(ValueError):  # larger than all that is kept
                held[material.id] = material
        try:
            body = draw(material.brdf, Picture(*task["picture"]))
        except bc.BrdfError as error:
            return {"problem": told(error)}, b""
        except Exception:
            traceback.print_exc()
            return {"failed": True}, b""
        return {"bytes": len(body)}, body

    with contextlib.suppress(BrokenPipeError):  # the service is gone
        for task in parent.tasks():
            parent.say(*answer(task))


if __name__ == "__main__":
    main()
