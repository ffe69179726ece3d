"""The names of a folder, kept, and looked up anew only when the folder has changed."""

from __future__ import annotations

import difflib
import os
import threading
import time
from bisect import bisect_left
from pathlib import Path

from brdf_service.library.store import NAME, SUFFIXES, Names

import brdfcore as bc

#: Seconds within which a second change of a folder may leave its time as it is.
_TICK = 0.05
#: Seconds after which what was noted of own changes is compared with the folder.
_DOUBT = 5.0
#: Names on either side of the place where one would stand, among which close ones are looked for.
_NEAR = 64
#: Ends of the names of files that a format reads and that are none of the service's own.
MEASURED = frozenset(end for ends in bc.extensions().values() for end in ends) - set(SUFFIXES)


class Index:
    """Names of one folder. Any thread may ask; a scan takes .2 s for 100,000 files and belongs off the event loop."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._scanning = threading.Lock()
        self._names = Names([], {}, [], [])
        self._known: set[str] = set()
        #: Time of the folder's last change that is known, and when it was looked at.
        self._changed, self._looked = -1, 0.0
        self._noted = False  # an own change since the last scan

    def names(self) -> Names:
        """All names, after a scan if the folder has changed."""
        if self._stale():
            with self._scanning:
                if self._stale():
                    self._scan()
        return self._names

    def note(self, name: str, there: bool, before: int) -> None:
        """A change of our own, while nobody else of us changes the folder; `before`: its time of change until then."""
        with self._scanning:
            if before != self._changed:
                return  # somebody else has changed it as well: the next question scans
            names = self._names.all
            place = bisect_left(names, name)
            if there != (names[place : place + 1] == [name]):
                changed = [*names[:place], *([name] if there else []), *names[place + (not there) :]]
                self._names = self._names._replace(all=changed)
            if name in self._names.measured:
                self._changed = -1
                return
            self._known = self._known | {name} if there else self._known - {name}
            self._changed, self._noted = os.stat(self._path).st_mtime_ns, True

    def close_to(self, name: str) -> list[str]:
        """Up to three names like this one, of those around its place in the list."""
        names, name = self._names.all, name[:64]
        place = bisect_left(names, name)
        near = names[max(0, place - _NEAR) : place + _NEAR]
        pairs = {name[k : k + 2] for k in range(len(name))}
        # a quick look at all of them leaves few for a slow one
        likely = sorted(near, key=lambda n: -len(pairs & {n[k : k + 2] for k in range(len(n))}) / (len(n) + 1))[:8]
        return difflib.get_close_matches(name, likely, n=3, cutoff=0.5)

    def _stale(self) -> bool:
        now = time.time()
        if os.stat(self._path).st_mtime_ns != self._changed:
            return True
        unsure = abs(self._looked - self._changed / 1e9) < _TICK
        return (unsure and now - self._looked > _TICK) or (self._noted and now - self._looked > _DOUBT)

    def _scan(self) -> None:
        changed, looked = os.stat(self._path).st_mtime_ns, time.time()
        known: set[str] = set()
        measured: dict[str, list[str]] = {}
        skipped: list[str] = []
        twice: list[str] = []
        with os.scandir(self._path) as entries:
            for entry in entries:
                file = entry.name
                stem, dot, end = file.rpartition(".")
                end = dot + end
                if not stem or file[0] == "." or not (end in SUFFIXES or end.lower() in MEASURED):
                    continue
                try:
                    wanted = entry.is_file() or entry.is_symlink()  # a link that leads nowhere is told of
                except OSError:  # or in a circle
                    wanted = True
                if not wanted:
                    continue
                if not NAME.fullmatch(stem):
                    skipped.append(os.fsencode(file).decode("utf-8", "backslashreplace"))
                elif end in SUFFIXES:
                    if stem in known:
                        twice.append(stem)
                    known.add(stem)
                else:
                    measured.setdefault(stem, []).append(file)
        waiting: dict[str, str] = {}
        for stem, files in measured.items():
            if stem not in known:
                waiting[stem] = min(files)
                skipped += sorted(files)[1:]  # one name, one material
        new, old = known | waiting.keys(), self._known | self._names.measured.keys()
        if len(new ^ old) < len(new) // 100:  # a sort of all holds the interpreter's lock for long
            ordered = list(self._names.all)
            for name in new - old:
                ordered.insert(bisect_left(ordered, name), name)
            for name in old - new:
                del ordered[bisect_left(ordered, name)]
        else:
            ordered = sorted(new)
        self._names, self._known = Names(ordered, waiting, sorted(skipped), twice), known
        self._changed, self._looked, self._noted = changed, looked, False
