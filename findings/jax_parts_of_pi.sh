#!/bin/sh
# jax 0.10.2 (jaxlib 0.10.2, processor, Linux): under jax.jit, and there only, (C1 - x) + C2 with constants C1 and C2 becomes
# (C1 + C2) - x, rounded to the type. That is what keeps the digits of an angle from the horizon or from the mirror
# direction: pi/2 is no float32, so pi/2 - x is taken as (HIGH - x) + LOW, with HIGH the nearest float32 and LOW what is
# left, -4.4e-8. Compiled, LOW is lost.
# Seen, 1,000 float32 angles within 1e-3 rad of the horizon: the cosine as sin((HIGH - x) + LOW) is off by 2e-8 of its
# value (median; largest 1.1e-7) call by call, and by 8.7e-5 (median; largest .042) inside jax.jit. LOW added after a
# product, (HIGH - x) p(x) + LOW, keeps its digits in both.
# Why it matters: a BRDF divided by cos(theta_o), or a lobe at delta_phi = pi, is that much off, and only when compiled;
# the same source in numpy, torch and uncompiled jax is right, so that no test of the formula shows it.
# That compiled code may be reordered is said in jax-ml/jax#8022; not that this is what an exact reduction of pi meets.
# Exits with 0 while it is so.
set -eu
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/env"
"$folder/env/bin/pip" install -q jax==0.10.2 jaxlib==0.10.2
cat > "$folder/check.py" <<'CHECK'
import sys

import jax
import jax.numpy as jnp
import numpy as np

HIGH = float(np.float32(np.pi / 2))
LOW = np.pi / 2 - HIGH


def cosine(x):
    return jnp.sin((HIGH - x) + LOW)


def kept(x):
    """sin to third order is enough here; LOW comes last."""
    y = HIGH - x
    return y * (1 - y * y / 6) + LOW


below = np.linspace(1e-6, 1e-3, 1_000)
x = (np.pi / 2 - below).astype(np.float32)
exact = np.cos(x.astype(np.float64))
off = {}
for name, run in (("called", cosine), ("compiled", jax.jit(cosine)), ("kept", jax.jit(kept))):
    far = np.abs(np.asarray(run(jnp.asarray(x)), np.float64) / exact - 1)
    off[name] = float(np.median(far))
    print(f"{name:9} median {np.median(far):.2g}, largest {far.max():.2g}")
same = off["called"] < 1e-6 and off["compiled"] > 1e-5 and off["kept"] < 1e-6
print("as described" if same else "changed")
sys.exit(0 if same else 1)
CHECK
"$folder/env/bin/python" "$folder/check.py"
