"use strict";
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const all = (selector, within) => Array.from((within || document).querySelectorAll(selector));
  const byId = (id) => document.getElementById(id);
  const root = document.documentElement;
  const fixed = (value) => (Math.round(100 * value) / 100 + 0).toFixed(2); // zero has no sign

  // ---- layers

  for (const box of all("input[data-layer]")) {
    const apply = () => root.classList.toggle("hide-" + box.dataset.layer, !box.checked);
    box.addEventListener("change", apply);
    apply();
  }

  // ---- maps: enlarge, move, where the pointer is

  class View {
    constructor(svg) {
      this.svg = svg;
      this.frame = svg.parentElement;
      const box = svg.viewBox.baseVal;
      this.whole = { x: 0, y: 0, w: box.width, h: box.height };
      this.box = { ...this.whole };
      this.perMetre = Number(svg.dataset.perMetre);
      this.origin = svg.dataset.origin ? svg.dataset.origin.split(",").map(Number) : null;
      this.turned = Number(svg.dataset.turned || 0);
      this.listen();
      this.show();
    }

    // Units of the drawing in a pixel of the screen.
    unit() {
      const rect = this.svg.getBoundingClientRect();
      return Math.max(this.box.w / Math.max(rect.width, 1), this.box.h / Math.max(rect.height, 1));
    }

    show() {
      const { x, y, w, h } = this.box;
      this.svg.setAttribute("viewBox", `${x} ${y} ${w} ${h}`);
      this.svg.style.setProperty("--k", this.unit());
      this.svg.classList.toggle("moved", w < 0.999 * this.whole.w);
      this.scaleBar();
    }

    scaleBar() {
      const bar = this.frame.querySelector(".scale-bar");
      const metresPerPixel = this.unit() / this.perMetre;
      const longest = 130 * metresPerPixel;
      const power = 10 ** Math.floor(Math.log10(longest));
      const length = [5, 2, 1].map((lead) => lead * power).find((metres) => metres <= longest) || power;
      if (!Number.isFinite(length)) return;
      bar.firstElementChild.style.width = `${length / metresPerPixel}px`;
      bar.lastElementChild.textContent = length >= 1000 ? `${length / 1000} km` : `${Number(length.toPrecision(1))} m`;
      bar.classList.add("ready");
    }

    // The place in the drawing that is under the pointer.
    place(event) {
      const matrix = this.svg.getScreenCTM();
      return new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
    }

    // What was done to this map is done to its like of the other run as well.
    changed() {
      this.keepInside();
      this.show();
      const coupled = byId("coupled");
      if (!coupled || !coupled.checked) return;
      for (const other of views) {
        if (other !== this && other.svg.dataset.map === this.svg.dataset.map) other.follow(this);
      }
    }

    // Shows the same place at the same scale; of maps of space, which have views at several places, the same share of the whole.
    follow(other) {
      const share = other.box.w / other.whole.w;
      const middle = { x: other.box.x + other.box.w / 2, y: other.box.y + other.box.h / 2 };
      let [w, x, y] = [this.whole.w * share, (middle.x / other.whole.w) * this.whole.w, (middle.y / other.whole.h) * this.whole.h];
      if (this.origin && other.origin) {
        const scale = this.perMetre / other.perMetre;
        w = (this.box.w / this.unit()) * other.unit() * scale;
        [x, y] = [0, 1].map((k) => this.origin[k] + ([middle.x, middle.y][k] - other.origin[k]) * scale);
      }
      w = share > 0.999 ? this.whole.w : Math.min(Math.max(w, this.whole.w / 60), this.whole.w);
      const h = (this.whole.h * w) / this.whole.w;
      this.box = { x: x - w / 2, y: y - h / 2, w, h };
      this.keepInside();
      this.show();
    }

    zoom(factor, at) {
      const middle = at || { x: this.box.x + this.box.w / 2, y: this.box.y + this.box.h / 2 };
      const w = Math.min(Math.max(this.box.w / factor, this.whole.w / 60), this.whole.w);
      const share = w / this.box.w;
      this.box = {
        x: middle.x - (middle.x - this.box.x) * share,
        y: middle.y - (middle.y - this.box.y) * share,
        w,
        h: this.box.h * share,
      };
      this.changed();
    }

    move(dx, dy) {
      this.box.x += dx;
      this.box.y += dy;
      this.changed();
    }

    keepInside() {
      const clamp = (v, low, high) => Math.min(Math.max(v, low), Math.max(low, high));
      this.box.x = clamp(this.box.x, 0, this.whole.w - this.box.w);
      this.box.y = clamp(this.box.y, 0, this.whole.h - this.box.h);
    }

    bringIntoView([x, y]) {
      const { box } = this;
      if (x < box.x || y < box.y || x > box.x + box.w || y > box.y + box.h) {
        this.move(x - box.x - box.w / 2, y - box.y - box.h / 2);
      }
    }

    act(what) {
      if (what === "in") this.zoom(1.5);
      else if (what === "out") this.zoom(1 / 1.5);
      else { this.box = { ...this.whole }; this.changed(); }
    }

    listen() {
      const { svg } = this;
      for (const button of all("[data-zoom]", this.frame)) {
        button.addEventListener("click", () => this.act(button.dataset.zoom));
      }
      svg.addEventListener("wheel", (event) => {
        if (!event.ctrlKey && !event.metaKey && document.activeElement !== svg) return;
        event.preventDefault();
        this.zoom(Math.exp(-0.0015 * event.deltaY), this.place(event));
      }, { passive: false });
      svg.addEventListener("dblclick", (event) => this.zoom(2, this.place(event)));
      svg.addEventListener("keydown", (event) => this.key(event));
      svg.addEventListener("pointermove", (event) => this.tellPlace(event));
      svg.addEventListener("pointerleave", () => { this.frame.querySelector(".at").textContent = ""; });
      this.listenToDrags();
      new ResizeObserver(() => this.show()).observe(svg);
    }

    key(event) {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const step = this.box.w / 8;
      const acts = {
        "+": () => this.act("in"), "=": () => this.act("in"), "-": () => this.act("out"), "0": () => this.act("all"),
        ArrowLeft: () => this.move(-step, 0), ArrowRight: () => this.move(step, 0),
        ArrowUp: () => this.move(0, -step), ArrowDown: () => this.move(0, step),
      };
      if (!acts[event.key]) return;
      event.preventDefault();
      acts[event.key]();
    }

    tellPlace(event) {
      if (!this.origin) return;
      const at = this.place(event);
      const [right, up] = [(at.x - this.origin[0]) / this.perMetre, (this.origin[1] - at.y) / this.perMetre];
      const [s, c] = [Math.sin(this.turned), Math.cos(this.turned)];
      const [x, y] = [c * right - s * up, s * right + c * up];
      this.frame.querySelector(".at").textContent = `x ${fixed(x)} m, y ${fixed(y)} m`;
    }

    listenToDrags() {
      const { svg } = this;
      let from = null;
      svg.addEventListener("pointerdown", (event) => {
        if (event.button === 0) from = { x: event.clientX, y: event.clientY, far: false };
      });
      svg.addEventListener("pointermove", (event) => {
        if (!from) return;
        const [dx, dy] = [event.clientX - from.x, event.clientY - from.y];
        if (!from.far && Math.hypot(dx, dy) < 4) return;
        if (!from.far) { svg.setPointerCapture(event.pointerId); svg.classList.add("dragging"); }
        from = { x: event.clientX, y: event.clientY, far: true };
        this.move(-dx * this.unit(), -dy * this.unit());
      });
      const end = (event) => {
        const closure = from && !from.far && event.target.closest(".closure");
        from = null;
        svg.classList.remove("dragging");
        if (closure) choose(svg.closest(".map-figure").dataset.run, Number(closure.dataset.closure), false);
      };
      svg.addEventListener("pointerup", end);
      svg.addEventListener("pointercancel", () => { from = null; svg.classList.remove("dragging"); });
    }
  }

  const views = all("svg.map").map((svg) => new View(svg));

  // ---- closures: what a click shows

  let chosen = null;
  let asked = null;

  const rowOf = (run, number) => document.querySelector(`[data-row="${run}-${number}"]`);

  function choose(run, number, withFocus) {
    const closure = data[run] && data[run].closures[number];
    if (!closure) return;
    chosen = { run, number, closure };
    mark();
    const several = Object.keys(data).length > 1 ? ` of run ${run.toUpperCase()}` : "";
    byId("detail-title").textContent = `Candidate ${number + 1}${several}: ${closure.verdict}`;
    byId("detail-reason").textContent = closure.reason;
    const numbers = [["keyframes", `${closure.from} → ${closure.to}`], ["times", closure.times.join(" → ")], ...closure.numbers];
    byId("detail-numbers").replaceChildren(...numbers.flatMap(([name, value]) => [element("dt", name), element("dd", value)]));
    byId("detail-body").hidden = false;
    const found = document.querySelector("input[name=placing][value=found]");
    found.disabled = !(closure.placing && closure.placing.found);
    if (found.disabled) document.querySelector("input[name=placing][value=mapped]").checked = true;
    draw();
    history.replaceState(null, "", `#closure=${run}-${number + 1}`);
    if (withFocus) {
      byId("detail").scrollIntoView({ block: "nearest" });
      byId("detail-title").focus({ preventScroll: true });
    }
  }

  function element(name, text) {
    const made = document.createElement(name);
    made.textContent = text;
    return made;
  }

  function mark() {
    all(".chosen").forEach((known) => known.classList.remove("chosen"));
    if (!chosen) return;
    const row = rowOf(chosen.run, chosen.number);
    if (row) row.classList.add("chosen");
    for (const figure of all(`.map-figure[data-run="${chosen.run}"]`)) {
      for (const group of all(`[data-closure="${chosen.number}"]`, figure)) {
        group.classList.add("chosen");
        const at = group.querySelector(".mark").transform.baseVal.consolidate().matrix;
        views.find((view) => figure.contains(view.svg)).bringIntoView([at.e, at.f]);
      }
    }
  }

  function step(by) {
    const rows = all(`[data-row^="${chosen.run}-"]`);
    const at = rows.indexOf(rowOf(chosen.run, chosen.number));
    const next = rows[(at + by + rows.length) % rows.length];
    if (next) choose(chosen.run, Number(next.dataset.row.split("-")[1]), false);
  }

  function close() {
    chosen = null;
    mark();
    byId("detail-body").hidden = true;
    byId("detail-title").textContent = "A closure";
    byId("detail-reason").textContent = "Choose a closure on the map or in the table below.";
    history.replaceState(null, "", location.pathname + location.search);
    if (asked) asked.focus();
    asked = null;
  }

  document.addEventListener("click", (event) => {
    const button = event.target.closest("button.choose");
    if (!button) return;
    asked = button;
    choose(button.dataset.run, Number(button.dataset.closure), true);
  });
  byId("previous").addEventListener("click", () => step(-1));
  byId("next").addEventListener("click", () => step(1));
  byId("close").addEventListener("click", close);
  document.addEventListener("keydown", (event) => { if (event.key === "Escape" && chosen) close(); });
  all("input[name=placing]").forEach((radio) => radio.addEventListener("change", draw));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);

  // ---- two submaps over each other

  // Pairs of 16 bits, the lower byte first, centimetres; as metres.
  function points(run, keyframe) {
    const bytes = atob(data[run].submaps[keyframe] || "");
    const value = (at) => ((bytes.charCodeAt(at) | (bytes.charCodeAt(at + 1) << 8)) << 16) >> 16;
    const made = [];
    for (let at = 0; at + 3 < bytes.length; at += 4) made.push([value(at) / 100, value(at + 2) / 100]);
    return made;
  }

  function draw() {
    if (!chosen) return;
    const canvas = byId("overlay");
    const pen = canvas.getContext("2d");
    pen.clearRect(0, 0, canvas.width, canvas.height);
    const { run, closure } = chosen;
    const placing = closure.placing;
    const colour = (name) => getComputedStyle(root).getPropertyValue(name).trim();
    if (!placing) {
      tell(canvas, pen, colour("--text"), "Of this one no submaps were kept: the page stays small.");
      return;
    }
    const asMatched = document.querySelector("input[name=placing]:checked").value === "found" && placing.found;
    const [x, y, turn] = asMatched ? placing.found : [...placing.mapped, 0];
    const [c, s] = [Math.cos(turn), Math.sin(turn)];
    const old = points(run, closure.from);
    const now = points(run, closure.to).map(([u, v]) => [c * u - s * v + x, s * u + c * v + y]);
    const fit = frame(canvas, [...old, ...now, [0, 0], [x, y]]);
    pen.fillStyle = colour("--old");
    for (const [px, py] of old.map(fit.place)) { pen.beginPath(); pen.arc(px, py, 3.4, 0, 7); pen.fill(); }
    pen.strokeStyle = colour("--new");
    pen.lineWidth = 1.2;
    pen.beginPath();
    for (const [px, py] of now.map(fit.place)) {
      pen.moveTo(px - 4, py); pen.lineTo(px + 4, py); pen.moveTo(px, py - 4); pen.lineTo(px, py + 4);
    }
    pen.stroke();
    robots(pen, [[fit.place([0, 0]), colour("--old")], [fit.place([x, y]), colour("--new")]]);
    ruler(canvas, pen, fit.scale, colour("--text"));
    canvas.setAttribute("aria-label", `Submaps of keyframes ${closure.from} (${old.length} points) and ${closure.to} ` +
      `(${now.length} points) over each other, ${asMatched ? "as the match found them" : "as the map has them"}`);
    canvas.dataset.drawn = `${old.length},${now.length}`;
  }

  function tell(canvas, pen, colour, text) {
    pen.fillStyle = colour;
    pen.font = "20px system-ui, sans-serif";
    pen.fillText(text, 24, 40);
    canvas.setAttribute("aria-label", text);
    canvas.dataset.drawn = "0,0";
  }

  // What shows all points at one scale, y upwards.
  function frame(canvas, shown) {
    const cut = Math.floor(shown.length / 50); // single far points would make all else small
    const range = (k) => {
      const along = shown.map((p) => p[k]).sort((a, b) => a - b);
      return [along[cut], along[along.length - 1 - cut]];
    };
    const [[x0, x1], [y0, y1]] = [range(0), range(1)];
    const scale = Math.min((canvas.width - 40) / Math.max(x1 - x0, 0.5), (canvas.height - 70) / Math.max(y1 - y0, 0.5));
    const [mx, my] = [(x0 + x1) / 2, (y0 + y1) / 2];
    return { scale, place: ([x, y]) => [canvas.width / 2 + (x - mx) * scale, canvas.height / 2 - 12 - (y - my) * scale] };
  }

  function robots(pen, places) {
    for (const [[px, py], colour] of places) {
      pen.strokeStyle = colour;
      pen.lineWidth = 3;
      pen.beginPath();
      pen.arc(px, py, 9, 0, 7);
      pen.stroke();
    }
  }

  function ruler(canvas, pen, scale, colour) {
    const length = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20].filter((metres) => metres * scale <= 180).pop() || 0.1;
    pen.fillStyle = colour;
    pen.fillRect(20, canvas.height - 18, length * scale, 4);
    pen.font = "18px system-ui, sans-serif";
    pen.fillText(`${length} m`, 28 + length * scale, canvas.height - 12);
  }

  // ---- plots: the time under the pointer, and where the robot was then

  function showRobot(run, seconds) {
    const way = data[run].way;
    let [low, high] = [0, way.length];
    while (low < high) { const middle = (low + high) >> 1; if (way[middle][0] < 10 * seconds) low = middle + 1; else high = middle; }
    const [, map, at] = way[Math.min(low, way.length - 1)] || [];
    for (const figure of all(`.map-figure[data-run="${run}"]`)) {
      const here = figure.querySelector(".here");
      const shown = at !== undefined && figure.querySelector("svg.map").dataset.map === String(map);
      here.toggleAttribute("hidden", !shown);
      if (!shown) continue;
      const circles = at.filter((_, k) => k % 2 === 0).map((_, k) => {
        const circle = document.createElementNS("http://www.w3.org/2000/svg", "circle");
        circle.setAttribute("cx", at[2 * k]);
        circle.setAttribute("cy", at[2 * k + 1]);
        return circle;
      });
      here.replaceChildren(...circles);
    }
  }

  for (const plot of all("svg[data-plot]")) {
    const [left, right, seconds, top] = plot.dataset.plot.split(",").map(Number);
    const figure = plot.closest("figure");
    const output = figure.querySelector("figcaption").appendChild(document.createElement("output"));
    const side = plot.closest(".side");
    const runs = side ? [side.dataset.name.toLowerCase()] : Object.keys(data);
    const lines = all("path.line", plot).map((line) => line.getAttribute("d").split(/[ML]/).filter(Boolean).map((pair) => pair.split(" ").map(Number)));
    const cursor = plot.querySelector(".cursor");
    plot.addEventListener("pointermove", (event) => {
      const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(plot.getScreenCTM().inverse()).x;
      const x = Math.min(Math.max(at, left), right);
      const time = seconds * (x - left) / (right - left);
      const values = lines.map((line) => {
        const nearest = line.reduce((best, pair) => Math.abs(pair[0] - x) < Math.abs(best[0] - x) ? pair : best);
        return (top * (1 - (nearest[1] - 8) / 140)).toPrecision(3);
      });
      output.textContent = [`at ${time.toFixed(1)} s`, ...values].join(": ");
      cursor.setAttribute("x1", x);
      cursor.setAttribute("x2", x);
      cursor.removeAttribute("hidden");
      runs.forEach((run) => showRobot(run, time));
    });
    plot.addEventListener("pointerleave", () => {
      output.textContent = "";
      cursor.setAttribute("hidden", "");
      all(".here").forEach((here) => here.setAttribute("hidden", ""));
    });
  }

  // ---- a link to a closure

  const asked_for = /^#closure=([a-z])-(\d+)$/.exec(location.hash);
  if (asked_for) choose(asked_for[1], Number(asked_for[2]) - 1, false);
  root.dataset.ready = "true";
})();
