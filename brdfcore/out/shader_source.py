"""The look-ups as shader source: one text in GLSL, from which WGSL is made by rules of spelling.

The text keeps to what both languages have: every local is assigned once with its type before it, numbers carry their
decimal point, integers are int, a choice is `P_pick(otherwise, then, condition)`. P stands for the name of the
material, words in capitals for constants of the table. The arithmetic is that of `kernels.tables.half_coordinates`,
`lobe_grid`, `half_difference` and `trilinear`, in float32: exponents are taken from and put into the bits, as a
shader's sine and arccosine are good to some 1e-4 only, and its powers to 1e-5.
"""

from __future__ import annotations

import re

_COMMON = """\
float P_line(int base, int cell, float part) {
  float low = P_at(base + cell);
  return low + part * (P_at(base + cell + 1) - low);
}

int P_cell(float position, int nodes) {
  return clamp(int(floor(position)), 0, nodes - 2);
}

vec3 P_node(int node) {
  NODE
}

vec3 P_edge(int node, float w) {
  vec3 low = P_node(node);
  return low + w * (P_node(node + 1) - low);
}

vec3 P_face(int node, float v, float w) {
  vec3 low = P_edge(node, w);
  return low + v * (P_edge(node + P_N2, w) - low);
}

vec3 P_trilinear(int i, int j, int l, float u, float v, float w) {
  int node = (i * P_N1 + j) * P_N2 + l;
  vec3 low = P_face(node, v, w);
  return low + u * (P_face(node + P_N1 * P_N2, v, w) - low);
}

"""

_HALF = """\
// where x lies in a map that is uniform in its bits: step, and part of it
int P_bits(float x, int first, int last) {
  return clamp(floatBitsToInt(x) - first, 0, last - 1);
}

float P_exp2(float x) {
  float whole = clamp(floor(x + 0.5), -126.0, 126.0);
  float f = x - whole;
  float p0 = 0.009676031918322054 + f * 0.0013390863364671234;
  float p1 = 0.05550357114219078 + f * p0;
  float p2 = 0.2402210748530834 + f * p1;
  float p3 = 0.6931471880262288 + f * p2;
  return (1.0 + f * p3) * intBitsToFloat((int(whole) + 127) << 23u);
}

// f_r in 1/sr, without the cosine; wi to the light, wo to the viewer, of any length, normal +z
vec3 P_f(vec3 wi, vec3 wo) {
  if (!(wi.z > 0.0 && wo.z > 0.0)) {
    return vec3(0.0);
  }
  // both as unit vectors, by sums and differences of what is given, which near the mirror direction lose no digit
  float li = sqrt(dot(wi, wi));
  float lo = sqrt(dot(wo, wo));
  vec3 apart = wo - wi;
  vec3 sum = wo + wi;
  float longer = -dot(apart, sum) / (lo * (lo + li));
  float unit = 1.0 / li;
  vec3 h = (ABOUT + wo * longer) * unit;
  float ci = max(wi.z * unit, HORIZON);
  float co = max(wo.z / lo, HORIZON);
  float rise = (apart.z + wo.z * longer) * unit;
  float total = co + ci;
  float ix = wi.x * unit;
  float iy = wi.y * unit;
  float across = h.x * h.x + h.y * h.y;
  float turned = ix * h.y - iy * h.x;
COORDINATES
  float up = abs(turned);
  float both = abs(x) + up;
  float z0 = P_pick(1.0, up / both, both > 0.0);
  float z1 = Z_FOLD;
  float z2 = Z_SIDE;
  int at_u = P_bits(u, P_FIRST_U, P_LAST_U);
  int step_u = at_u >> P_SHIFT_U;
  float part_u = float(at_u & P_MASK_U) * P_PART_U;
  int at_w = P_bits(w, P_FIRST_W, P_LAST_W);
  int step_w = at_w >> P_SHIFT_W;
  float part_w = float(at_w & P_MASK_W) * P_PART_W;
  float place_z = z2 * P_STEPS_Z;
  int step_z = P_cell(place_z, P_NODES_Z);
  float exponent = P_line(P_GUIDE_H, step_u, part_u) + P_line(P_GUIDE_D, step_w, part_w);
  float p = P_line(P_MAP_H, step_u, part_u);
  float q = P_line(P_MAP_D, step_w, part_w);
  float r = P_line(P_MAP_P, step_z, place_z - float(step_z));
  int c0 = P_cell(p, P_N0);
  int c1 = P_cell(q, P_N1);
  int c2 = P_cell(r, P_N2);
  vec3 value = P_trilinear(c0, c1, c2, p - float(c0), q - float(c1), r - float(c2));
  return value * (P_exp2(exponent) * (GROWTH));
}
"""

_GRID = """\
int P_side(int cell, int nodes, bool from_end) {
  if (from_end) {
    return nodes - 2 - cell;
  }
  return cell;
}

// f_r in 1/sr, without the cosine; wi to the light, wo to the viewer, of any length, normal +z
vec3 P_f(vec3 wi, vec3 wo) {
  if (!(wi.z > 0.0 && wo.z > 0.0)) {
    return vec3(0.0);
  }
  // each angle from the nearer end of its axis: horizon and mirror direction keep their digits
  float ri = sqrt(wi.x * wi.x + wi.y * wi.y);
  float ro = sqrt(wo.x * wo.x + wo.y * wo.y);
  float turned = wi.x * wo.y - wi.y * wo.x;
  float along = wi.x * wo.x + wi.y * wo.y;
  float ahead = P_pick(along, 1.0, turned == 0.0 && along == 0.0);
  float x = atan(min(ri, wi.z), max(ri, wi.z)) * P_PER_I;
  float y = atan(min(ro, wo.z), max(ro, wo.z)) * P_PER_O;
  float z = atan(abs(turned), AHEAD) * P_PER_D;
  int c0 = P_cell(x, P_N0);
  int c1 = P_cell(y, P_N1);
  int c2 = P_cell(z, P_N2);
  float u0 = min(x - float(c0), 1.0);
  float v0 = min(y - float(c1), 1.0);
  float w0 = min(z - float(c2), 1.0);
  int i = P_side(c0, P_N0, ri > wi.z);
  int j = P_side(c1, P_N1, ro > wo.z);
  int l = P_side(c2, P_N2, FROM_END);
  float u = P_pick(u0, 1.0 - u0, ri > wi.z);
  float v = P_pick(v0, 1.0 - v0, ro > wo.z);
  float w = P_pick(w0, 1.0 - w0, FROM_END);
  return FOUND;
}
"""

#: u, w and the cosine of the azimuth, x, by the kind of table and centre.
COORDINATES = {
    ("half_difference", 0): """\
  float u = across / (total * total);
  float w = min(0.25 * (total * total + across), 1.0);
  float x = rise * sqrt(w);""",
    ("half_difference", 1): """\
  float u = 0.25 * (rise * rise + across);
  float w = min(0.25 * (total * total + across), 1.0);
  float x = rise * sqrt(w);""",
    ("lobe_grid", 0): """\
  float u = across / (total * total);
  float w = ci / (1.0 + sqrt(ix * ix + iy * iy));
  float x = h.x * ix + h.y * iy;""",
    ("lobe_grid", 1): """\
  float u = 0.25 * (rise * rise + across);
  float w = ci / (1.0 + sqrt(ix * ix + iy * iy));
  float x = rise + 2.0 * ci * u;""",
}
COORDINATES["lobe_grid", 2] = COORDINATES["lobe_grid", 1]

#: What each language says before: where the nodes are, and the choice that WGSL calls `select`.
_GLSL = """\
uniform highp sampler2D P_nodes;

float P_pick(float otherwise, float then, bool chosen) {
  if (chosen) {
    return then;
  }
  return otherwise;
}

float P_at(int n) {
  return texelFetch(P_nodes, ivec2(n % WIDTH, n / WIDTH), 0).r;
}

"""
_WGSL = """\
@group(GROUP) @binding(BINDING) var<storage, read> P_nodes: array<f32>;

float P_pick(float otherwise, float then, bool chosen) {
  return select(otherwise, then, chosen);
}

float P_at(int n) {
  return P_nodes[n];
}

"""
_TYPES = {"float": "f32", "int": "i32", "bool": "bool", "vec3": "vec3f"}
_SPELT = {
    "floatBitsToInt": "bitcast<i32>",
    "intBitsToFloat": "bitcast<f32>",
    "atan": "atan2",
    "float": "f32",
    "int": "i32",
    "vec3": "vec3f",
}


def source(
    language: str,
    kind: str,
    name: str,
    words: dict[str, str],
    constants: dict[str, float | int],
    beside: dict[str, int],
) -> str:
    """The text in "glsl" or "wgsl", of `kind` "half" or "grid".

    words      what stands for the words in capitals: expressions.
    constants  numbers that become constants P_...; an int stays one.
    beside     WIDTH, GROUP, BINDING.
    """
    text = _COMMON + (_HALF if kind == "half" else _GRID)
    for word, written in words.items():
        text = re.sub(rf"\b{word}\b", lambda _, w=written: w, text)  # type: ignore[misc]
    lines = []
    for word, number in constants.items():
        unsigned = word.startswith("SHIFT")
        kind_of = ("uint" if unsigned else "int") if isinstance(number, int) else "float"
        lines.append(f"const {kind_of} P_{word} = {_number(number)}{'u' if unsigned else ''};")
    text = "\n".join(lines) + "\n\n" + (_GLSL if language == "glsl" else _WGSL) + text
    for word, value in beside.items():
        text = re.sub(rf"\b{word}\b", str(value), text)
    if language == "wgsl":
        text = _as_wgsl(text)
    return re.sub(r"\bP_", f"{name}_", text)


def _as_wgsl(text: str) -> str:
    text = re.sub(r"const (\w+) (\w+) = ", lambda m: f"const {m[2]}: {_TYPES.get(m[1], 'u32')} = ", text)
    text = re.sub(
        r"^(float|int|vec3) (\w+)\((.*)\) \{$",
        lambda m: f"fn {m[2]}({_parameters(m[3])}) -> {_TYPES[m[1]]} {{",
        text,
        flags=re.MULTILINE,
    )
    text = re.sub(r"^( +)(float|int|vec3) (\w+) = ", lambda m: f"{m[1]}let {m[3]}: {_TYPES[m[2]]} = ", text, flags=re.M)
    return re.sub(r"\b(" + "|".join(_SPELT) + r")\(", lambda m: _SPELT[m[1]] + "(", text)


def _parameters(text: str) -> str:
    pairs = (p.split() for p in text.split(","))
    return ", ".join(f"{name}: {_TYPES[kind]}" for kind, name in pairs)


def _number(x: float | int) -> str:
    return str(x) if isinstance(x, int) else repr(float(x))
