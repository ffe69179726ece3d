#!/bin/sh
# Radiance (pyradiance 1.3.1, Linux) shows the "Reflection Front" of a BSDF file from BELOW the surface, and its
# "Reflection Back" from above, where the normal points to the viewer; of a side that the file does not hold it makes
# black, without a word. What else a file says wrongly is passed over too.
# Seen: a Klems matrix of a white diffuser (f = .5/pi) with "Reflection Front" alone has a directional-hemispherical
# reflectance of 0 for light from above, .5 from below; with "Reflection Back" alone it is the other way round. One of
# f = 1.5/pi, which reflects 1.5 times what arrives, is read and reflects that. 41 numbers behind the end of the matrix
# are passed over, a matrix that ends 41 numbers early is refused.
# Why it matters: a laboratory measures the front and writes "Reflection Front"; the material then renders black.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q pyradiance==1.3.1
cat > "$folder/check.py" <<'EOF'
import math
import subprocess
import sys

NAME, PATCHES = "LBNL/Klems Quarter", 41
RINGS = ((0, 9, 1), (9, 27, 8), (27, 45, 12), (45, 63, 12), (63, 90, 8))


def xml(side, values):
    basis = "".join(
        f"<AngleBasisBlock><Theta>{(a + b) / 2 if a else 0}</Theta><nPhis>{n}</nPhis><ThetaBounds>"
        f"<LowerTheta>{a}</LowerTheta><UpperTheta>{b}</UpperTheta></ThetaBounds></AngleBasisBlock>"
        for a, b, n in RINGS
    )
    return (
        '<?xml version="1.0"?><WindowElement xmlns="http://windows.lbl.gov"><Optical><Layer><Material><Name>m</Name>'
        "<Manufacturer>m</Manufacturer></Material><DataDefinition>"
        "<IncidentDataStructure>Columns</IncidentDataStructure>"
        f"<AngleBasis><AngleBasisName>{NAME}</AngleBasisName>{basis}</AngleBasis></DataDefinition><WavelengthData>"
        '<Wavelength unit="Integral">Visible</Wavelength><WavelengthDataBlock>'
        f"<WavelengthDataDirection>Reflection {side}</WavelengthDataDirection>"
        f"<ColumnAngleBasis>{NAME}</ColumnAngleBasis><RowAngleBasis>{NAME}</RowAngleBasis>"
        f"<ScatteringDataType>BRDF</ScatteringDataType><ScatteringData>{', '.join(map(str, values))}</ScatteringData>"
        "</WavelengthDataBlock></WavelengthData></Layer></Optical></WindowElement>"
    )


ASK = """
import os, sys
import pyradiance.bsdf as bsdf
seen = bsdf.load_file(sys.argv[1])
said = "refused" if seen is None else " ".join(f"{bsdf.direct_hemi(seen, t, 10.0, 13):.2f}" for t in (20.0, 160.0))
print(said, flush=True)
os._exit(0)
"""


def asked(name, side, level, count=PATCHES**2):
    path = f"{name}.xml"
    open(path, "w").write(xml(side, [level / math.pi] * count))
    done = subprocess.run([sys.executable, "-c", ASK, path], capture_output=True, text=True)
    return done.stdout.strip()


found = {
    "front": asked("front", "Front", 0.5),
    "back": asked("back", "Back", 0.5),
    "bright": asked("bright", "Back", 1.5),
    "long": asked("long", "Back", 0.5, PATCHES**2 + PATCHES),
    "short": asked("short", "Back", 0.5, PATCHES**2 - PATCHES),
}
for name, seen in found.items():
    print(f"{name:7} reflectance from above and from below: {seen}")
expected = {"front": "0.00 0.50", "back": "0.50 0.00", "bright": "1.50 0.00", "long": "0.50 0.00", "short": "refused"}
if found != expected:
    sys.exit("Radiance reads these files otherwise than it did")
EOF
cd "$folder"
"$folder/env/bin/python" check.py
