"""BSDF files of LBNL's WINDOW and of Radiance (XML): Klems matrices and tensor trees of rank 3, read and written.

Values are f in 1/sr without the cosine, averaged over patches: a Klems patch is about ten degrees wide, so a lobe
narrower than that is gone, and no reader interpolates. Read to a `patch_grid`, a step function, which answers as these
programs do. Reflection is read, of one side; transmission is left out, by name. WINDOW's "Reflection Back" is what
Radiance shows of a surface seen from above (its normal towards the viewer), so that is the side read where both are
there; both sides are written. A Klems matrix of an anisotropic sample (its patches of one difference of azimuth differ)
and a tensor tree of rank 4 are refused, or averaged over rotation with isotropic="mean".
"""

from __future__ import annotations

import hashlib
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from brdfcore.base.atomic import write_file
from brdfcore.base.brdf import FLAGS, Brdf
from brdfcore.base.channels import VALUE, Channels
from brdfcore.base.errors import FileFormatError, InputError
from brdfcore.base.parameters import Parameter, resolve
from brdfcore.formats.base.format import Format, LossWarning, read_bytes
from brdfcore.formats.base.import_report import measures_of, value_range
from brdfcore.formats.base.measurements import ANISOTROPY
from brdfcore.formats.base.rotations import ISOTROPIC, anisotropic, lost_sentence
from brdfcore.formats.bsdf_xml import klems, tree
from brdfcore.formats.bsdf_xml.document import Element, bad, numbers, parse
from brdfcore.formats.bsdf_xml.write import BASIS_NAMES, document
from brdfcore.metrics import measured_flags
from brdfcore.tables.patch_grid import PatchGrid

Float64Array = npt.NDArray[np.float64]

#: Largest file read: a tensor tree of a million values has 10 MB.
MAX_BYTES = 32_000_000
_MOST_WAVELENGTHS = 512
_SIDES = {"back": "Reflection Back", "front": "Reflection Front"}
_DIRECTIONS = (*_SIDES.values(), "Transmission Front", "Transmission Back")
_CONVENTIONS = {
    "value": "f_r in 1/sr, without the cosine, averaged over a patch of incident and one of outgoing directions",
    "side": "WINDOW's Reflection Back is what Radiance shows from above; its Reflection Front from below",
    "azimuth": "of an incident patch, that in which light travels: a mirror reflects a patch into the same",
    "between patches": "a step function: constant within a patch, as WINDOW and Radiance read it",
}


class BsdfXmlFormat(Format):
    """Klems matrix (full, half, quarter, or a basis that the file defines) or tensor tree of rank 3, XML."""

    name = "bsdf_xml"
    SUMMARY = "Klems matrix or tensor tree of WINDOW and Radiance (XML): patch averages of reflection"
    REFERENCE = (
        "LBNL, WINDOW Technical Documentation; G. Ward, M. Kurt, N. Bonneel, Reducing anisotropic BSDF measurement to "
        "common practice, MAM workshop 2014, DOI 10.2312/mam.20141292; Radiance, bsdf_m.c and bsdf_t.c"
    )
    EXTENSIONS = (".xml",)
    PARAMETERS = (
        ISOTROPIC,
        Parameter("side", "", "which reflection: back is what Radiance shows from above", "back", kind="choice",
                  choices=tuple(_SIDES)),
    )  # fmt: skip
    WRITE_PARAMETERS = (
        Parameter("basis", "", "Klems basis, or a tensor tree", "full", kind="choice", choices=BASIS_NAMES),
        Parameter("resolution", "", "of a tree: cells along each axis of wo, a power of two", 32, kind="integer",
                  bounds=(4, 128), per_channel=False),
        Parameter("channel", "", "the one channel to write; not given: all, of X, Y, Z or R, G, B or one", None,
                  kind="text"),
    )  # fmt: skip
    writable = True
    exact = False

    def sniff(self, head: bytes) -> bool:
        return head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"<") and b"<WindowElement" in head

    def read(self, path: Path, **options: Any) -> Brdf:
        """Read a file. `StorageError` if it can't be opened, `LimitError` above `MAX_BYTES`, `FileFormatError` naming
        file, field and line if it is damaged, has a document type, is anisotropic or holds no reflection."""
        given = resolve("format 'bsdf_xml'", self.PARAMETERS, options)
        data = read_bytes(path, MAX_BYTES)
        return _Reader(path.name, data, given).brdf()

    def write(self, brdf: Brdf, path: Path, **options: Any) -> Brdf:
        """Write the patch averages of `brdf`, of both sides; what they cost is said in a `LossWarning`.

        A `patch_grid` that was read from such a file is written with its own patches. `InputError` for a perfect mirror
        part, and for channels other than one, R, G, B or X, Y, Z.
        """
        given = resolve("writing format 'bsdf_xml'", self.WRITE_PARAMETERS, options)
        text, losses = document(brdf, given)
        again = write_file(path, text.encode(), self.read)
        for sentence in losses:
            warnings.warn(sentence, LossWarning, stacklevel=2)
        return again


class _Reader:
    """One file on its way to a table."""

    def __init__(self, file: str, data: bytes, given: dict[str, Any]) -> None:
        self.file, self.data, self.given = file, data, given
        self.done: list[str] = []
        self.warnings: list[str] = []

    def brdf(self) -> PatchGrid:
        root = parse(self.data, self.file)
        layer = root.first("Optical", "Layer")
        if root.name != "WindowElement" or layer is None:
            raise bad(self.file, "WindowElement", root.line, f"{root.name}, without Optical/Layer", "a BSDF file")
        definition = layer.first("DataDefinition")
        structure = layer.words("DataDefinition", "IncidentDataStructure")
        if definition is None or structure not in ("Columns", "Rows", "TensorTree3", "TensorTree4"):
            raise bad(
                self.file, "IncidentDataStructure", (definition or layer).line, structure or "nothing",
                "Columns, Rows, TensorTree3 or TensorTree4",
            )  # fmt: skip
        if structure == "TensorTree4" and self.given["isotropic"] != "mean":
            raise anisotropic(
                self.file, "IncidentDataStructure", structure,
                f"line {definition.line}: a tensor tree of rank 4, which holds every rotation of the sample",
                line=definition.line,
            )  # fmt: skip
        blocks, channels = self._blocks(layer)
        table = (
            self._tree(blocks, channels, structure)
            if structure.startswith("TensorTree")
            else self._matrix(blocks, channels, definition, structure == "Rows")
        )
        self._describe(table, layer, structure)
        return table

    def _blocks(self, layer: Element) -> tuple[list[Element], Channels]:
        """The blocks of the wanted side, one a wavelength, and the channels that they are."""
        found: dict[str, dict[str, Element]] = {}
        for data in layer.all("WavelengthData"):
            wave = data.first("Wavelength")
            label = " ".join(wave.text.split()) if wave is not None else "Visible"
            for block in data.all("WavelengthDataBlock"):
                direction = block.words("WavelengthDataDirection")
                if direction not in _DIRECTIONS:
                    raise bad(self.file, "WavelengthDataDirection", block.line, direction or "nothing",
                              ", ".join(_DIRECTIONS))  # fmt: skip
                if label in found.setdefault(direction, {}):
                    raise bad(self.file, "Wavelength", block.line, f"{direction} of {label} a second time", "each once")
                found[direction][label] = block
        self.found = {direction: list(waves) for direction, waves in found.items()}
        wanted = _SIDES[self.given["side"]]
        other = _SIDES["front" if self.given["side"] == "back" else "back"]
        gone = [d for d in found if d.startswith("Transmission")]
        if wanted not in found and other not in found:
            raise FileFormatError(
                "transmission_only",
                f"{self.file}: holds {', '.join(gone) or 'no data'} and no reflection, and reflectance is read only",
                where=self.file,
                file=self.file,
                line=layer.line,
                field="WavelengthDataDirection",
                got=", ".join(gone),
                expected="Reflection Front or Back",
            )
        if wanted not in found:
            self.done.append(f"there is no {wanted}: {other} is read")
            wanted = other
        elif other in found and any(
            self._data(found[other][k]).text != self._data(b).text if k in found[other] else True
            for k, b in found[wanted].items()
        ):
            self.warnings.append(f"{wanted} is read; {other} is there too, and side= chooses it")
        if gone:
            self.warnings.append(f"{' and '.join(gone)} left out: only reflectance is held")
        self.side = wanted
        if len(found[wanted]) > _MOST_WAVELENGTHS:
            raise bad(
                self.file, "Wavelength", layer.line, f"{len(found[wanted])} of them", f"at most {_MOST_WAVELENGTHS}"
            )
        return _ordered(found[wanted])

    def _matrix(self, blocks: list[Element], channels: Channels, definition: Element, rows: bool) -> PatchGrid:
        bases = klems.bases_of(definition, self.file)
        named = [self._bases(block, bases) for block in blocks]
        if any(pair != named[0] for pair in named):
            raise bad(self.file, "ColumnAngleBasis", blocks[0].line, "other bases at other wavelengths", "the same")
        inner, outer = named[0]
        matrix = np.empty((len(blocks), inner.size, outer.size))
        for k, block in enumerate(blocks):
            values = numbers(self._data(block), self.file, inner.size * outer.size)
            matrix[k] = values.reshape(inner.size, outer.size) if rows else values.reshape(outer.size, -1).T
        values, loss = klems.isotropic_part(matrix, inner, outer)
        if self.given["isotropic"] == "mean":
            self.done.append(lost_sentence(f"{inner.size} x {outer.size} patches", loss))
        elif loss > ANISOTROPY:
            raise anisotropic(
                self.file, "ScatteringData", loss,
                f"patches with one difference of azimuth differ from their mean by {loss:.1%} of the reflected energy "
                f"(limit {ANISOTROPY:.0%})", line=blocks[0].line,
            )  # fmt: skip
        else:
            self.done.append(
                f"patches with one difference of azimuth averaged: {loss:.2g} of the reflected energy apart (L1)"
            )
        bilateral = np.array_equal(values, values[:, :, ::-1])
        if bilateral:
            values = values[:, :, : values.shape[2] // 2]
        arrays = {"values": np.ascontiguousarray(values)}
        arrays |= {"theta_i": np.radians(inner.edges), "theta_o": np.radians(outer.edges)}
        self.bases = [inner.name, outer.name]
        return self._table(arrays, channels, bilateral, "rings")

    def _tree(self, blocks: list[Element], channels: Channels, structure: str) -> PatchGrid:
        if structure == "TensorTree4":
            means = [tree.mean_over_rotation(self._data(block), self.file) for block in blocks]
            parts = [values for values, _ in means]
            self.done.append(lost_sentence("a tensor tree of rank 4", max(loss for _, loss in means)))
        else:
            parts = [tree.values_of(self._data(block), self.file) for block in blocks]
            if self.given["isotropic"] == "mean":
                self.done.append("isotropic='mean' asked of an isotropic file: nothing to average")
        side = max(p.shape[0] for p in parts)
        fine = [_repeated(p, side // p.shape[0]) for p in parts]
        self.bases = ["LBNL/Shirley-Chiu"]
        return self._table({"values": np.stack(fine, axis=-1)}, channels, False, "disk")

    def _table(self, arrays: dict[str, Float64Array], channels: Channels, bilateral: bool, kind: str) -> PatchGrid:
        negative = int((arrays["values"] < 0).sum())
        if negative:
            self.warnings.append(f"{negative} patches are negative; they are kept, while Radiance reads them as 0")
        flags = {"bilateral": bilateral, "reciprocal": False, "energy_conserving": False, "non_negative": not negative}
        table = PatchGrid.from_arrays(arrays, {"coordinates": kind}, channels, flags)
        found = measured_flags(table)
        for flag in FLAGS:
            if flag != "non_negative" and (flag != "bilateral" or kind == "disk"):
                setattr(table, flag, found[flag])
        return table

    def _bases(self, block: Element, bases: dict[str, klems.Basis]) -> tuple[klems.Basis, klems.Basis]:
        found = []
        for name in ("ColumnAngleBasis", "RowAngleBasis"):
            word = block.words(name)
            if word.lower() not in bases:
                known = ", ".join(b.name for b in bases.values())[:200]
                raise bad(self.file, name, block.line, word or "nothing", f"one of {known}")
            found.append(bases[word.lower()])
        if klems.cells_of(*found) > 8_192:
            raise bad(self.file, "RowAngleBasis", block.line, "bases that have no common division", "of one kind")
        return found[0], found[1]

    def _data(self, block: Element) -> Element:
        data = block.first("ScatteringData")
        if data is None:
            raise bad(self.file, "ScatteringData", block.line, "nothing", "the values of the block")
        return data

    def _describe(self, table: PatchGrid, layer: Element, structure: str) -> None:
        sha = hashlib.sha256(self.data).hexdigest()
        name = layer.words("Material", "Name")[:200]
        table.source = {"name": self.file, "format": "bsdf_xml", "sha256": sha}
        table.metadata = {"description": name} if name else {}
        table.metadata["bsdf_xml"] = {"structure": structure, "bases": self.bases, "channels": self.labels}
        cells = " x ".join(map(str, table.values.shape[:3]))
        tree_of = table.coordinates == "disk"
        widest = f"a {table.values.shape[1]}th of the square" if tree_of else "10 to 15 degrees"
        self.warnings.append(
            f"the values are averages over patches ({widest} wide), and no reader interpolates: a narrower lobe is "
            "lost, and the table is a step function"
        )
        table.report = {
            "format": "bsdf_xml",
            "file": self.file,
            "sha256": sha,
            "bytes": len(self.data),
            "conventions": dict(_CONVENTIONS),
            "found": {
                "description": name,
                "structure": structure,
                "bases": self.bases,
                "side": self.side,
                "blocks": self.found,
                "channels": table.channels.to_json(),
                "patches": cells,
                "range": value_range(table.values, table.channels),
            },
            **measures_of(table, table.values),
            "done": self.done,
            "warnings": self.warnings,
        }

    @property
    def labels(self) -> list[str]:
        return self.found[self.side]


def _repeated(cells: Float64Array, times: int) -> Float64Array:
    """Each cell `times` along each axis."""
    return cells.repeat(times, 0).repeat(times, 1).repeat(times, 2)


def _ordered(found: dict[str, Element]) -> tuple[list[Element], Channels]:
    """Blocks and channels: X, Y, Z where these are there, wavelengths in nm, else the names that the file has."""
    labels = {label.lower(): label for label in found}
    middle = labels.get("cie-y", labels.get("visible"))
    if "cie-x" in labels and "cie-z" in labels and middle is not None and len(found) == 3:
        return [found[labels["cie-x"]], found[middle], found[labels["cie-z"]]], Channels(("X", "Y", "Z"))
    if len(found) == 1:
        return list(found.values()), VALUE
    try:
        waves = sorted((float(label), block) for label, block in ((k, id(b)) for k, b in found.items()))
        blocks = {id(b): b for b in found.values()}
        return [blocks[key] for _, key in waves], Channels([w for w, _ in waves], "wavelength")
    except (ValueError, InputError):
        return list(found.values()), Channels([label[:40] for label in found], "name")
