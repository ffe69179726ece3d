#!/bin/sh
# Radiance (pyradiance 1.3.1, Linux) reads a Klems matrix by the NAME of its angle basis and leaves aside the definition
# that the file itself gives. The names have changed their meaning: bsdf_m.c of 2015 (revision 3.29) has
# "LBNL/Klems Half" with 73 patches and "LBNL/Klems Quarter" with rings to 46 and 66 degrees; that of 2022 (3.46), which
# pyradiance holds, has 77 patches, and rings to 45 and 63.
# Seen: a file that defines LBNL/Klems Half with 73 patches is refused ("Bad/missing BSDF ScatteringData"); one that
# defines LBNL/Klems Quarter with the older rings (41 patches, as now) is read without a word, at other angles: of a
# matrix that is bright for light from the fourth ring only, the reflectance at 45.5 degrees of incidence is that of
# the fourth ring, 45 to 63, not of the third, 27 to 46, as the file says. The same numbers under a name of their own
# are read as the file defines them.
# Why it matters: a material measured or written with the older basis is rendered wrong in silence.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q pyradiance==1.3.1
cat > "$folder/check.py" <<'EOF'
import math
import subprocess
import sys


def xml(name, edges, patches, values):
    rings = "".join(
        f"<AngleBasisBlock><Theta>{(a + b) / 2 if a else 0}</Theta><ThetaBounds><LowerTheta>{a}</LowerTheta>"
        f"<UpperTheta>{b}</UpperTheta></ThetaBounds><nPhis>{n}</nPhis></AngleBasisBlock>"
        for a, b, n in zip(edges, edges[1:], patches)
    )
    data = ",\n".join(", ".join(map(str, row)) for row in values)
    block = "".join(
        f"<WavelengthDataBlock><WavelengthDataDirection>Reflection {side}</WavelengthDataDirection>"
        f"<ColumnAngleBasis>{name}</ColumnAngleBasis><RowAngleBasis>{name}</RowAngleBasis>"
        f"<ScatteringDataType>BRDF</ScatteringDataType><ScatteringData>{data}</ScatteringData></WavelengthDataBlock>"
        for side in ("Front", "Back")
    )
    return (
        '<?xml version="1.0"?><WindowElement xmlns="http://windows.lbl.gov"><Optical><Layer><Material><Name>m</Name>'
        "<Manufacturer>m</Manufacturer></Material><DataDefinition>"
        "<IncidentDataStructure>Columns</IncidentDataStructure>"
        f"<AngleBasis><AngleBasisName>{name}</AngleBasisName>{rings}</AngleBasis></DataDefinition><WavelengthData>"
        f'<Wavelength unit="Integral">Visible</Wavelength>{block}</WavelengthData></Layer></Optical></WindowElement>'
    )


ASK = """
import os, sys
import pyradiance.bsdf as bsdf
seen = bsdf.load_file(sys.argv[1])
print("refused" if seen is None else f"{bsdf.direct_hemi(seen, 45.5, 10.0, 13):.4f}", flush=True)
os._exit(0)
"""


def asked(name, edges, patches, values):
    path = name.replace("/", "_").replace(" ", "_") + ".xml"
    open(path, "w").write(xml(name, edges, patches, values))
    done = subprocess.run([sys.executable, "-c", ASK, path], capture_output=True, text=True)
    return done.stdout.strip()


half = (0, 6.5, 19.5, 32.5, 46.5, 61.5, 76.5, 90), (1, 8, 12, 16, 20, 12, 4)
flat = [[0.2] * 73 for _ in range(73)]
quarter = (0, 9, 27, 46, 66, 90), (1, 8, 12, 12, 8)
# f = 0.05, and 0.25 for light from the fourth ring
ring = [[0.25 if 21 <= i < 33 else 0.05 for i in range(41)] for _ in range(41)]
found = {
    "half by its name": asked("LBNL/Klems Half", *half, flat),
    "half by another": asked("Other Half", *half, flat),
    "quarter by its name": asked("LBNL/Klems Quarter", *quarter, ring),
    "quarter by another": asked("Other Quarter", *quarter, ring),
}
for what, said in found.items():
    print(f"{what}: {said}")
assert found["half by its name"] == "refused", found
assert abs(float(found["half by another"]) - 0.2 * math.pi) < 1e-2, found
assert abs(float(found["quarter by its name"]) - 0.25 * math.pi) < 1e-2, found
assert abs(float(found["quarter by another"]) - 0.05 * math.pi) < 1e-2, found
EOF
cd "$folder"
"$folder/env/bin/python" check.py
