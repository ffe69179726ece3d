"use strict";
// Draws each material's front from the JSON beside it; without scripts the table says the same.
(function () {
  const NS = "http://www.w3.org/2000/svg", H = 430, L = 96, R = 24, T = 18, B = 54;
  const WIDEST = 1080, NARROWEST = 440; // as wide as the page, so that letters keep their size
  const SHAPES = ["circle", "square", "triangle", "diamond", "down", "cross"];
  const BANDS = { nbytes: "no table", ns: "" };

  function node(name, attributes, parent, text) {
    const made = document.createElementNS(NS, name);
    for (const key in attributes) made.setAttribute(key, attributes[key]);
    if (text !== undefined) made.textContent = text;
    if (parent) parent.appendChild(made);
    return made;
  }
  function marker(shape, x, y, r) {
    const p = { square: [[-1, -1], [1, -1], [1, 1], [-1, 1]], triangle: [[0, -1.2], [1.1, .9], [-1.1, .9]],
      diamond: [[0, -1.35], [1.2, 0], [0, 1.35], [-1.2, 0]], down: [[0, 1.2], [1.1, -.9], [-1.1, -.9]] }[shape];
    if (shape === "cross") return node("path", { d: `M${x - r},${y - r}L${x + r},${y + r}M${x - r},${y + r}L${x + r},${y - r}` });
    if (!p) return node("circle", { cx: x, cy: y, r: r });
    return node("polygon", { points: p.map(([a, b]) => `${x + a * r},${y + b * r}`).join(" ") });
  }
  function style(made, e, looks) {
    const { colour } = looks[e.representation];
    made.setAttribute("stroke", colour);
    made.setAttribute("stroke-width", 2);
    made.setAttribute("fill", e.kind === "peer" ? "none" : e.on_front ? colour : "#fff");
    return made;
  }
  const power = (k, key) => key === "nbytes"
    ? (k >= 9 ? `${10 ** (k - 9)} GB` : k >= 6 ? `${10 ** (k - 6)} MB` : k >= 3 ? `${10 ** (k - 3)} kB` : `${10 ** k} bytes`)
    : k >= 3 ? `${10 ** (k - 3)} µs` : `${10 ** k} ns`;

  function draw(section) {
    const data = JSON.parse(section.querySelector("script[type='application/json']").textContent);
    const box = section.querySelector(".plot"), looks = data.looks;
    let key = "nbytes", W = WIDEST;
    const tip = document.createElement("div");
    tip.className = "tip";
    tip.hidden = true;

    function paint() {
      box.querySelector("svg.front")?.remove();
      W = Math.max(NARROWEST, Math.min(WIDEST, box.clientWidth - 18));
      const svg = node("svg", { class: "front", viewBox: `0 0 ${W} ${H}`, role: "img", "aria-label": "error against " + (key === "ns" ? "time" : "bytes") });
      const all = data.entries.filter(e => e.error !== null);
      const positive = all.map(e => e[key]).filter(v => v > 0);
      const lo = Math.floor(Math.log10(Math.min(...positive)) - .15), hi = Math.ceil(Math.log10(Math.max(...positive)) + .1);
      const none = key === "nbytes" && all.some(e => e.nbytes === 0) ? 90 : 0;
      const X = v => v > 0 ? L + none + (Math.log10(v) - lo) / (hi - lo) * (W - R - L - none) : L + 40;
      const least = 1e-6, top = Math.max(.03, ...all.map(e => e.error), data.tolerance) * 1.6;
      const Y = v => H - B - 26 - (Math.log10(Math.max(v, least)) - Math.log10(least)) / (Math.log10(top) - Math.log10(least)) * (H - B - T - 26);
      const yt = Y(data.tolerance);
      node("rect", { x: L, y: yt, width: W - R - L, height: H - B - yt, fill: "#e6f2e6" }, svg);
      for (let k = -6; 10 ** k <= top; k++) {
        node("line", { x1: L, x2: W - R, y1: Y(10 ** k), y2: Y(10 ** k), stroke: "#ddd" }, svg);
        node("text", { x: L - 8, y: Y(10 ** k) + 4, "text-anchor": "end" }, svg, k === -6 ? "exact" : `${+(100 * 10 ** k).toPrecision(2)} %`);
      }
      for (let k = lo; k <= hi; k++) {
        const x = X(10 ** k);
        node("line", { x1: x, x2: x, y1: T, y2: H - B, stroke: "#ddd" }, svg);
        const every = Math.ceil(70 * (hi - lo) / (W - R - L - none)); // as many as there is room for
        if ((!none || k > lo) && (hi - k) % every === 0) node("text", { x: x, y: H - B + 18, "text-anchor": k === hi ? "end" : "middle" }, svg, power(k, key));
      }
      if (none) node("text", { x: L + 40, y: H - B + 18, "text-anchor": "middle" }, svg, BANDS.nbytes);
      node("line", { x1: L, x2: W - R, y1: H - B, y2: H - B, stroke: "#222" }, svg);
      node("line", { x1: L, x2: W - R, y1: yt, y2: yt, stroke: "#1a6b28", "stroke-dasharray": "6 4" }, svg);
      // below the points, on the side where few of them are
      node("text", { x: L + 8, y: yt + 17, style: "fill:#1a6b28;font-weight:700" }, svg, "right enough: " + data.tolerance_text + " or less");
      node("text", { x: (L + W - R) / 2, y: H - 10, "text-anchor": "middle" }, svg, key === "ns"
        ? (W < 700 ? "time of a look-up (further left is better)" : "time of one look-up, of a million at once on one core (further left is better)")
        : "memory of the table (further left is better)");
      node("text", { x: 0, y: 0, transform: `translate(16 ${(T + H - B) / 2}) rotate(-90)`, "text-anchor": "middle" }, svg, "error: energy misplaced (lower is better)");
      const path = [];
      for (const e of data.entries.filter(e => e.on_front).sort((a, b) => a[key] - b[key] || a.error - b.error))
        if (!path.length || e.error < path[path.length - 1].error) path.push(e);
      node("polyline", { points: path.map(e => `${X(e[key])},${Y(e.error)}`).join(" "), fill: "none", stroke: "#888" }, svg);
      for (const e of all) {
        const x = X(e[key]), y = Y(e.error);
        if (key === "ns" && e.kind !== "peer") node("line", { x1: x, x2: X(Math.min(e.ns_median, 10 ** hi)), y1: y, y2: y, stroke: looks[e.representation].colour, "stroke-width": 1.5, opacity: .5 }, svg);
        const point = style(marker(looks[e.representation].shape, x, y, 6), e, looks);
        point.setAttribute("tabindex", 0);
        node("title", {}, point, `${e.label}: ${e.words}`);
        svg.appendChild(point);
        const show = () => {
          tip.textContent = "";
          const head = document.createElement("b");
          head.textContent = e.label;
          tip.append(head, document.createElement("br"), e.words, document.createElement("br"), e.verdict);
          tip.hidden = false;
          const scale = box.clientWidth / W, left = x * scale + 16;
          tip.style.left = (left > box.clientWidth - 300 ? Math.max(4, x * scale - 300) : left) + "px";
          tip.style.top = Math.max(0, y * scale - 20) + "px";
          section.querySelectorAll("tr[data-k]").forEach(r => r.classList.toggle("lit", +r.dataset.k === e.k));
        };
        const hide = () => { tip.hidden = true; section.querySelectorAll("tr.lit").forEach(r => r.classList.remove("lit")); };
        point.addEventListener("mouseenter", show);
        point.addEventListener("focus", show);
        point.addEventListener("mouseleave", hide);
        point.addEventListener("blur", hide);
      }
      const halo = "font-weight:700;paint-order:stroke;stroke:#fff;stroke-width:4px;fill:";
      const c = data.entries[data.chosen], cx = X(c[key]), cy = Y(c.error), far = cx > W * .6, low = cy > H - B - 50;
      node("circle", { cx: cx, cy: cy, r: 13, fill: "none", stroke: "#cc3311", "stroke-width": 2.5, "pointer-events": "none" }, svg);
      const label = node("text", { x: cx + (far ? -18 : 18), y: cy + (low ? -14 : -12), "text-anchor": far ? "end" : "start", "pointer-events": "none" }, svg, (data.met ? "use this: " : "closest: ") + c.label);
      label.setAttribute("style", halo + "#cc3311");
      box.prepend(svg);
    }
    box.appendChild(tip);
    const legend = document.createElement("div");
    legend.className = "legend";
    for (const name in looks) {
      const item = document.createElement("span"), svg = node("svg", { viewBox: "-8 -8 16 16" });
      const sample = data.entries.find(e => e.representation === name);
      svg.appendChild(style(marker(looks[name].shape, 0, 0, 5), { ...sample, on_front: true }, looks));
      item.append(svg, " " + name + (sample.kind === "peer" ? " (another library)" : ""));
      legend.appendChild(item);
    }
    const note = document.createElement("span");
    note.className = "faint";
    note.textContent = "filled: on the front; hollow: something else is no larger, no slower and no less exact";
    legend.appendChild(note);
    box.appendChild(legend);
    section.querySelectorAll(".switch button").forEach(button => button.addEventListener("click", () => {
      key = button.dataset.key;
      section.querySelectorAll(".switch button").forEach(b => b.setAttribute("aria-pressed", b === button));
      paint();
    }));
    paint();
    let wide = box.clientWidth;
    window.addEventListener("resize", () => { if (box.clientWidth !== wide) { wide = box.clientWidth; paint(); } });
  }
  document.querySelectorAll("section.material").forEach(draw);
})();
