// Comfort only: without this file the forms are ordinary forms and every link works.
"use strict";

for (const button of document.querySelectorAll(".copy")) {
  if (!navigator.clipboard) continue; // browsers offer it on localhost and over https only
  button.hidden = false;
  button.addEventListener("click", async () => {
    await navigator.clipboard.writeText(button.previousElementSibling.textContent);
    button.textContent = "copied";
    setTimeout(() => { button.textContent = "copy"; }, 1500);
  });
}

const draw = document.getElementById("draw");
if (draw) {
  const picture = document.getElementById("picture");
  const frame = picture.parentElement;
  const problem = document.getElementById("picture-error");
  let latest = 0;

  const asked = () => {
    const query = new URLSearchParams(new FormData(draw));
    if (!query.get("channel")) query.delete("channel");
    return query;
  };

  const link = () => {
    const query = asked();
    const numbers = new URLSearchParams(query);
    numbers.delete("scale"); // numbers have none
    for (const a of document.querySelectorAll("#formats a")) {
      const format = a.dataset.format;
      if (format === "permanent") a.href = `${draw.dataset.permanent}/slice.svg?${query}`;
      else a.href = `${draw.dataset.path}/slice.${format}?${format === "csv" || format === "json" ? numbers : query}`;
    }
  };

  const redraw = async () => {
    const turn = ++latest; // an answer that comes after a newer question is dropped
    const query = asked();
    const address = `${draw.dataset.path}/slice.svg?${query}`;
    frame.classList.add("busy");
    try {
      const answer = await fetch(address);
      if (turn !== latest) return;
      if (answer.ok) {
        picture.src = address;
        frame.hidden = false;
        problem.hidden = true;
        history.replaceState(null, "", `?${query}`);
        link();
      } else {
        problem.textContent = (await answer.json()).detail;
        problem.hidden = false;
        frame.hidden = picture.naturalWidth === 0; // an earlier picture stays, a broken one goes
      }
    } catch (error) {
      problem.textContent = "The service does not answer.";
      problem.hidden = false;
    } finally {
      if (turn === latest) frame.classList.remove("busy");
    }
  };

  draw.addEventListener("submit", (event) => { event.preventDefault(); redraw(); });
  draw.addEventListener("change", redraw);
  // one angle fits all directions, several the plane: keep the middle one, and give the others back afterwards
  let several = "";
  draw.elements.view.addEventListener("change", () => {
    const field = draw.elements.theta_i;
    const angles = field.value.split(",");
    if (draw.elements.view.value === "hemisphere" && angles.length > 1) {
      several = field.value;
      field.value = angles[Math.floor(angles.length / 2)].trim();
    } else if (draw.elements.view.value === "polar" && several) {
      field.value = several;
      several = "";
    }
  });
  link();
  // the first picture was asked for by the page itself; if it failed, say why
  if (picture.complete && picture.naturalWidth === 0) redraw();
  else picture.addEventListener("error", redraw, { once: true });
}

const evaluate = document.getElementById("evaluate");
if (evaluate) {
  const values = document.getElementById("values");
  const labels = JSON.parse(evaluate.dataset.labels);

  const say = (text) => {
    const p = document.createElement("p");
    p.className = "warning";
    p.textContent = text;
    values.replaceChildren(p);
  };

  const show = (points, mirror) => {
    const table = document.createElement("table");
    const head = table.insertRow();
    for (const label of labels) {
      const th = document.createElement("th");
      th.scope = "col";
      th.textContent = `f_r, ${label}`;
      head.append(th);
    }
    for (const point of points) {
      const row = table.insertRow();
      for (const value of point) {
        const cell = row.insertCell();
        cell.className = "number";
        cell.textContent = value === null ? "not finite" : String(value);
      }
    }
    const unit = document.createElement("p");
    unit.className = "hint";
    unit.textContent = (points.length > 1 ? "one row a direction, " : "") + "in 1/sr, without the cosine" + (mirror ? "; the perfect mirror part is left out" : "");
    const scroll = document.createElement("div");
    scroll.className = "scroll";
    scroll.append(table);
    values.replaceChildren(scroll, unit);
  };

  evaluate.addEventListener("submit", async (event) => {
    event.preventDefault();
    try {
      const answer = await fetch(`${evaluate.action}?${new URLSearchParams(new FormData(evaluate))}`);
      const content = await answer.json();
      if (answer.ok) show(content.values, content.has_delta);
      else say(content.detail);
    } catch (error) {
      say("The service does not answer.");
    }
  });
}

const weigh = document.getElementById("weigh");
if (weigh) {
  const form = weigh.querySelector("form");
  const [start, cancel] = form.querySelectorAll("button");
  const told = weigh.querySelector("[role=status]");
  const bar = told.querySelector("progress");
  const problem = weigh.querySelector("[role=alert]");
  const found = weigh.querySelector(".found");
  let job = null; // path of the one that is followed

  const busy = (is) => {
    start.disabled = is;
    cancel.hidden = told.hidden = !is;
  };

  const fail = (text) => {
    job = null;
    busy(false);
    problem.textContent = text;
    problem.hidden = false;
  };

  const paragraph = (tag, text) => {
    const made = document.createElement(tag);
    made.textContent = text;
    return made;
  };

  const show = (content) => {
    const [report] = content.result.materials;
    const figure = document.createElement("figure");
    figure.className = "picture";
    const picture = document.createElement("img");
    picture.src = content.links.picture;
    picture.alt = "error against bytes and against the time of a look-up, of every representation tried";
    figure.append(picture);
    const advice = paragraph("p", report.advice);
    advice.className = "lead";
    const others = document.createElement("ul");
    others.append(...report.alternatives.map((text) => paragraph("li", text)));
    const links = paragraph("p", "");
    links.className = "links";
    for (const [text, address] of [["all the numbers", content.links.self], ["the picture", content.links.picture]]) {
      const a = paragraph("a", text);
      a.href = address;
      links.append(a);
    }
    found.replaceChildren(advice, others, figure, links);
    found.hidden = false;
  };

  const follow = async (path) => {
    while (job === path) {
      const answer = await fetch(path);
      const content = await answer.json();
      if (job !== path) return;
      if (!answer.ok) return fail(content.detail);
      const { done, total, stage } = content.progress;
      if (content.state === "running" && done) { bar.max = total; bar.value = done; } else bar.removeAttribute("value");
      told.lastElementChild.textContent = content.state === "running" ? stage : `${content.state}, ${content.ahead} ahead`;
      if (content.state === "failed") return fail(content.problem.detail);
      if (content.state === "cancelled") { job = null; return busy(false); }
      if (content.state === "done") {
        job = null;
        busy(false);
        return show(content);
      }
      await new Promise((resolve) => { setTimeout(resolve, 1000); });
    }
  };

  weigh.hidden = false;
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    problem.hidden = true;
    const typed = new FormData(form).get("tolerance");
    const tolerance = typed.trim() && Number.isFinite(Number(typed)) ? Number(typed) : typed; // the service says what is wrong
    try {
      const answer = await fetch(`${weigh.dataset.path}/pareto`, {
        method: "POST",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ tolerance }),
      });
      const content = await answer.json();
      if (!answer.ok) return fail(content.detail);
      job = content.links.self;
      busy(true);
      await follow(job);
    } catch (error) {
      fail("The service does not answer.");
    }
  });
  cancel.addEventListener("click", () => { if (job) fetch(job, { method: "DELETE" }); });
}
