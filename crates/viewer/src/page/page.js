"use strict";
(() => {
const id = (name) => document.getElementById(name);
const root = document.documentElement;
const [ground, over] = [id("ground"), id("over")];
const gl = ground.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
const pen = over.getContext("2d"), T2 = gl.TEXTURE_2D;
const on = (target, names, act, how) => names.split(" ").forEach((name) => target.addEventListener(name, act, how));
const STATES = ["waiting", "accepted", "refused", "withdrawn"];
const STATUS = ["tracking", "degraded", "lost"];
const TILE = 64, PAGE = 1024, PER_PAGE = PAGE / TILE, FRESH_MS = 6000, GHOST_MS = 2500;

// ---- what is known; a connection begins with nothing

let run, asks, frozen = false, shown = { c: true, s: true, p: true };
const forget = () => {
  if (run) for (const page of run.pages.values()) gl.deleteTexture(page.texture);
  run = { cell: 0.05, space: false, can: 0, keyframes: [], closures: [], totals: [0, 0], scan: null, robot: null, pages: new Map(), clouds: new Map(), points: 0,
    fresh: true, words: [], events: [], ghost: null, at: 0, end: 0, speed: 1, paused: false, heights: [0, 1] };
};

// ---- the camera: parallel rays; straight from above it is a map

const eye = { x: 0, y: 0, z: 0, scale: 20, turn: 0, tilt: Math.PI / 2, follow: true };
let axes, size = [1, 1], colours = {};
const aim = () => {
  const [s, c, st, ct] = [Math.sin(eye.turn), Math.cos(eye.turn), Math.sin(eye.tilt), Math.cos(eye.tilt)];
  axes = [[c, s, 0], [-s * st, c * st, ct], [s * ct, -c * ct, st]];
};
const dot = (a, x, y, z) => a[0] * x + a[1] * y + a[2] * z;
const place = (p) => {
  const [x, y, z] = [p[0] - eye.x, p[1] - eye.y, p[2] - eye.z];
  return [size[0] / 2 + eye.scale * dot(axes[0], x, y, z), size[1] / 2 - eye.scale * dot(axes[1], x, y, z)];
};
const turned = (q, v) => {
  const [x, y, z, w] = q, [a, b, c] = v;
  const t = [2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)];
  return [a + w * t[0] + y * t[2] - z * t[1], b + w * t[1] + z * t[0] - x * t[2], c + w * t[2] + x * t[1] - y * t[0]];
};
const move = (dx, dy) => {
  const rise = Math.max(Math.sin(eye.tilt), 0.2) ** 2;
  eye.x -= (dx * axes[0][0] - dy * axes[1][0] / rise) / eye.scale;
  eye.y -= (dx * axes[0][1] - dy * axes[1][1] / rise) / eye.scale;
  follow(false);
};
const zoom = (factor, at = [size[0] / 2, size[1] / 2]) => {
  const before = eye.scale, held = eye.follow;
  eye.scale = Math.min(Math.max(eye.scale * factor, 0.05), 2000);
  const share = 1 - before / eye.scale;
  if (!held) move((size[0] / 2 - at[0]) * share * eye.scale / before, (size[1] / 2 - at[1]) * share * eye.scale / before);
  follow(held);
};
const all = () => {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  const add = (x, y) => { box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y); box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y); };
  for (const page of run.pages.values()) for (const t of page.known) { const [x, y] = t.split(",").map(Number), side = TILE * run.cell; add(x * side, y * side); add((x + 1) * side, (y + 1) * side); }
  run.keyframes.forEach(({ p: [x, y] }) => { const r = run.space ? 10 : 1; add(x - r, y - r); add(x + r, y + r); });
  if (box[0] > box[2]) return;
  [eye.x, eye.y] = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
  const narrow = size[0] < 700;
  eye.scale = Math.min((size[0] - (narrow ? 30 : 60)) / (box[2] - box[0]), (size[1] - (narrow ? 320 : run.can & 2 ? 260 : 120)) / (box[3] - box[1]));
  follow(false);
};
const press = (name, is) => id(name).setAttribute("aria-pressed", !!is);
const follow = (is) => { eye.follow = is; press("follow", is); draw(); };

// ---- graphics

const program = (vertex, fragment) => {
  const made = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, "#version 300 es\nprecision highp float;precision highp int;" + text);
    gl.compileShader(shader);
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  return new Proxy({}, { get: (known, name) => name === "use" ? () => gl.useProgram(made) : known[name] ??= gl.getUniformLocation(made, name) });
};
const SEEN = "uniform vec3 eye,right,up,near;uniform vec2 half_m;vec4 seen(vec3 p){p-=eye;return vec4(dot(right,p)/half_m.x,dot(up,p)/half_m.y,-dot(near,p)/2000.,1);}";
const cells = program(SEEN + "uniform vec3 box;out vec2 at;void main(){at=vec2(gl_VertexID&1,gl_VertexID>>1);gl_Position=seen(vec3(box.xy+at*box.z,0));}",
  "uniform sampler2D page;uniform vec3 low,mid,high;in vec2 at;out vec4 c;void main(){float v=texture(page,at,-1.).r*255./128.;c=vec4(v<1.?mix(low,mid,v):mix(mid,high,min(v-1.,1.)),1);}");
const dots = program(SEEN + "uniform sampler2D poses;uniform float size;uniform vec2 heights;layout(location=0)in vec4 point;layout(location=1)in uint keyframe;out float h;" +
  "void main(){ivec2 at=ivec2(int(keyframe&255u)*2,int(keyframe>>8));vec4 t=texelFetch(poses,at,0),q=texelFetch(poses,at+ivec2(1,0),0);vec3 p=point.xyz*t.w;" +
  "p=p+2.*cross(q.xyz,cross(q.xyz,p)+q.w*p)+t.xyz;h=(p.z-heights.x)/(heights.y-heights.x);gl_Position=t.w>0.?seen(p):vec4(2,2,2,1);gl_PointSize=size;}",
  "uniform vec3 low,high;in float h;out vec4 c;void main(){c=vec4(mix(low,high,clamp(h,0.,1.)),1);}");
const [poses, buffer, layout] = [gl.createTexture(), gl.createBuffer(), gl.createVertexArray()];
const plain = gl.createVertexArray();
gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);

const tile = (x, y, values) => {
  const [px, py] = [Math.floor(x / PER_PAGE), Math.floor(y / PER_PAGE)];
  const key = px + "," + py;
  let page = run.pages.get(key);
  if (!page) {
    page = { x: px, y: py, texture: gl.createTexture(), known: new Set() };
    run.pages.set(key, page);
    gl.bindTexture(T2, page.texture);
    gl.texStorage2D(T2, 6, gl.R8, PAGE, PAGE);
    gl.texSubImage2D(T2, 0, 0, 0, PAGE, PAGE, gl.RED, gl.UNSIGNED_BYTE, new Uint8Array(PAGE * PAGE).fill(128));
    for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR], [gl.TEXTURE_MAG_FILTER, gl.NEAREST], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]])
      gl.texParameteri(T2, name, value);
  }
  gl.bindTexture(T2, page.texture);
  gl.texSubImage2D(T2, 0, (x - px * PER_PAGE) * TILE, (y - py * PER_PAGE) * TILE, TILE, TILE, gl.RED, gl.UNSIGNED_BYTE, values);
  page.known.add(x + "," + y);
  page.stale = 1;
};

// All points in one buffer, in steps, with their keyframe's number; where keyframes are, and how long their steps, is in a texture.
const load = () => {
  let at = 0;
  for (const cloud of run.clouds.values()) at += cloud.points.length / 3;
  run.points = at;
  const data = new Int16Array(4 * at), number = new Uint16Array(data.buffer);
  at = 0;
  for (const [keyframe, { points }] of run.clouds) for (let k = 0; k < points.length; k += 3, at += 4) { data.set(points.subarray(k, k + 3), at); number[at + 3] = keyframe; }
  gl.bindVertexArray(layout);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
  gl.enableVertexAttribArray(0);
  gl.vertexAttribPointer(0, 3, gl.SHORT, false, 8, 0);
  gl.enableVertexAttribArray(1);
  gl.vertexAttribIPointer(1, 1, gl.UNSIGNED_SHORT, 8, 6);
  run.newClouds = 0;
};
const loadPoses = () => {
  const rows = Math.min(Math.ceil(run.keyframes.length / 256) || 1, 256), data = new Float32Array(rows * 2048), zs = [];
  run.keyframes.forEach(({ p, q, flags }, at) => {
    if (at >= 65536) return;
    data.set([...p, flags & 8 ? 0 : run.clouds.get(at)?.step || 0, ...q], 8 * at);
    zs.push(p[2]);
  });
  gl.bindTexture(T2, poses);
  gl.texImage2D(T2, 0, gl.RGBA32F, 512, rows, 0, gl.RGBA, gl.FLOAT, data);
  gl.texParameteri(T2, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(T2, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  zs.sort((a, b) => a - b);
  if (zs.length) run.heights = [zs[0] - 1, zs.at(-1) + 3];
  run.newPoses = 0;
};

const paint = () => {
  const scale = devicePixelRatio || 1;
  for (const canvas of [ground, over]) if (canvas.width !== Math.round(size[0] * scale) || canvas.height !== Math.round(size[1] * scale)) [canvas.width, canvas.height] = [Math.round(size[0] * scale), Math.round(size[1] * scale)];
  if (eye.follow && run.robot) [eye.x, eye.y, eye.z] = run.robot.p;
  aim();
  gl.viewport(0, 0, ground.width, ground.height);
  gl.clearColor(...(run.space ? colours.free : colours.unknown), 1);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  const look = (it) => {
    it.use();
    gl.uniform3f(it.eye, eye.x, eye.y, eye.z);
    ["right", "up", "near"].forEach((name, k) => gl.uniform3fv(it[name], axes[k]));
    gl.uniform2f(it.half_m, size[0] / 2 / eye.scale, size[1] / 2 / eye.scale);
  };
  look(cells);
  gl.bindVertexArray(plain);
  gl.uniform3fv(cells.low, colours.free);
  gl.uniform3fv(cells.mid, colours.unknown);
  gl.uniform3fv(cells.high, colours.wall);
  const side = PAGE * run.cell;
  for (const page of run.pages.values()) {
    gl.bindTexture(T2, page.texture);
    if (page.stale) gl.generateMipmap(T2);
    page.stale = 0;
    gl.uniform3f(cells.box, page.x * side, page.y * side, side);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }
  if (run.space) {
    if (run.newClouds) { load(); run.newPoses = 1; }
    if (run.newPoses) loadPoses();
    look(dots);
    gl.bindVertexArray(layout);
    gl.bindTexture(T2, poses);
    gl.enable(gl.DEPTH_TEST);
    gl.uniform1f(dots.size, Math.min(Math.max(eye.scale * 0.12, 1.5), 6) * scale);
    gl.uniform2f(dots.heights, ...run.heights);
    gl.uniform3fv(dots.low, colours.low);
    gl.uniform3fv(dots.high, colours.high);
    if (run.points) gl.drawArrays(gl.POINTS, 0, run.points);
    gl.disable(gl.DEPTH_TEST);
  }
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, ...size);
  pen.lineJoin = pen.lineCap = "round";
  annotate();
  ruler();
};

// ---- what lies over the map

const stroke = (points, colour, width, dash = [], alpha = 1) => {
  pen.beginPath();
  points.forEach((p, k) => p.gap || !k ? pen.moveTo(p[0], p[1]) : pen.lineTo(p[0], p[1]));
  pen.setLineDash(dash);
  [pen.strokeStyle, pen.lineWidth, pen.globalAlpha] = [colour, width, alpha];
  pen.stroke();
  pen.globalAlpha = 1;
};
const annotate = () => {
  const now = performance.now(), c = colours.css, way = [];
  for (const k of run.keyframes) { if (!k) break; const at = place(k.p); at.gap = k.flags & 4; way.push(at); }
  const count = way.length;
  if (run.ghost && now - run.ghost.at < GHOST_MS) { stroke(run.ghost.way.map(place), c.refused, 2, [5, 4], 1 - (now - run.ghost.at) / GHOST_MS); draw(); } else run.ghost = null;
  if (shown.p) {
    for (let k = 1; k < count; k++) {
      const width = 4 * run.keyframes[k].sigma * eye.scale;
      if (width > 4 && !way[k].gap) stroke([way[k - 1], way[k]], c.way, Math.min(width, 400), [], 0.2);
    }
    stroke(way, c.rim, 4);
    stroke(way, c.way, 2);
    for (let k = 1; k < count; k++) { const s = run.keyframes[k].flags & 3; if (s && !way[k].gap) stroke([way[k - 1], way[k]], s === 2 ? c.lost : c.degraded, 5); }
    if (run.robot && count) stroke([way[count - 1], place(run.robot.p)], c.way, 2);
  }
  if (shown.c) run.closures.forEach((closure) => {
    const age = now - closure.at, name = STATES[closure.state];
    if (closure.from >= count || closure.to >= count || closure.state === 2 && age > FRESH_MS) return;
    const [a, b] = [way[closure.from], way[closure.to]], fresh = age < FRESH_MS;
    stroke([a, b], c[name], fresh ? 3.5 : 2, closure.state === 1 ? [] : [6, 5], closure.state === 2 ? 1 - age / FRESH_MS : 1);
    for (const [x, y] of [a, b]) { pen.beginPath(); pen.arc(x, y, fresh ? 5 : 3, 0, 7); pen.fillStyle = c[name]; pen.fill(); }
    if (fresh) draw();
  });
  if (shown.s && run.scan) {
    pen.fillStyle = c.scan;
    const { p, q, points } = run.scan, r = run.space ? 1 : 1.5;
    for (let k = 0; k < points.length; k += 3) { const v = turned(q, points.subarray(k, k + 3)), [x, y] = place([p[0] + v[0], p[1] + v[1], p[2] + v[2]]); pen.fillRect(x - r, y - r, 2 * r, 2 * r); }
  }
  if (run.robot) robot(c);
};
const robot = (c) => {
  const { p, q, cov } = run.robot, [x, y] = place(p);
  // The covariance as the camera sees it.
  const m = (a, b) => dot(b, dot(a, cov[0], cov[1], cov[2]), dot(a, cov[1], cov[3], cov[4]), dot(a, cov[2], cov[4], cov[5]));
  const [xx, xy, yy] = [m(axes[0], axes[0]), m(axes[0], axes[1]), m(axes[1], axes[1])];
  const [mean, half] = [(xx + yy) / 2, Math.hypot((xx - yy) / 2, xy)];
  const radius = (v) => Math.min(2 * Math.sqrt(Math.max(v, 0)) * eye.scale, 1e4);
  if (radius(mean + half) > 3) {
    pen.beginPath();
    pen.ellipse(x, y, radius(mean + half), radius(mean - half), -Math.atan2(2 * xy, xx - yy) / 2, 0, 7);
    pen.globalAlpha = 0.25; pen.fillStyle = c.way; pen.fill(); pen.globalAlpha = 1;
  }
  const tip = (ahead, left) => { const v = turned(q, [ahead, left, 0]); return place([p[0] + v[0], p[1] + v[1], p[2] + v[2]]); };
  const r = Math.max(0.25, 9 / eye.scale);
  pen.beginPath();
  [[1.4, 0], [-1, 0.9], [-0.5, 0], [-1, -0.9]].forEach(([a, b], k) => pen[k ? "lineTo" : "moveTo"](...tip(a * r, b * r)));
  pen.closePath();
  [pen.fillStyle, pen.strokeStyle, pen.lineWidth] = [run.robot.status ? c[STATUS[run.robot.status]] : c.way, c.rim, 2];
  pen.setLineDash([]);
  pen.stroke();
  pen.fill();
};
const ruler = () => {
  const metres = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].filter((m) => m * eye.scale <= 140).pop() || 0.1;
  id("ruler").firstChild.style.width = metres * eye.scale + "px";
  id("ruler").lastChild.textContent = metres + " m";
};

// ---- messages: floats, unsigned and signed numbers, bytes and text of a record

const pose = (f, at) => ({ p: f.slice(at, at + 3), q: f.slice(at + 3, at + 7) });
const readers = [, (f, u) => {
  [run.cell, run.space, run.can] = [f[0], u[1], u[2]];
  id("clock").hidden = !(run.can & 2);
  root.classList.toggle("replay", run.can & 2);
  if (run.space && run.fresh && eye.tilt > 1.5) eye.tilt = 0.9;
}, (f, u, i, b) => {
  const values = new Uint8Array(TILE * TILE);
  for (let at = 8, k = 0; at < b.length; at += 2) values.fill(b[at + 1], k, k += b[at]);
  tile(i[0], i[1], values);
}, (f, u) => {
  const before = run.keyframes.slice(0, run.totals[0]).map((known) => known.p);
  let far = 0;
  for (let at = 1, k = u[0]; at < u.length; at += 9, k++) {
    run.keyframes[k] = { ...pose(f, at), sigma: f[at + 7], flags: u[at + 8] };
    if (before[k]) far = Math.max(far, Math.hypot(...before[k].map((x, a) => x - f[at + a])));
  }
  if (far > 0.05 && !run.ghost) run.ghost = { way: before, at: performance.now() };
  run.newPoses = 1;
}, (f, u) => {
  for (let at = 1, k = u[0]; at < u.length; at += 3, k++) {
    const [from, to, what] = u.subarray(at, at + 3), known = run.closures[k];
    if (known && known.from === from && known.to === to && known.what === what) continue;
    run.closures[k] = { from, to, what, state: what & 255, at: run.fresh ? -1e9 : performance.now() };
    if (from < 2 ** 32 - 1) run.events.push(k);
  }
  run.events = run.events.slice(-30);
  run.told = 1;
}, (f) => { run.scan = { ...pose(f, 0), points: f.slice(7) }; },
(f, u) => { run.robot = { ...pose(f, 0), cov: f.slice(7, 13), status: u[14], joined: u[15] }; },
(f, u, i, b, text) => id("lines").replaceChildren(...text().split("\n").filter(Boolean).flatMap((line) => line.split("\t").map((part, k) => element(k ? "dd" : "dt", part)))),
(f, u) => { [run.at, run.end, run.speed, run.paused] = [f[0], f[1], f[2], u[3]]; },
(f, u, i, b) => { run.clouds.set(u[0], { step: f[1], points: new Int16Array(b.slice(8).buffer) }); run.newClouds = 1; },
(f, u) => {
  run.totals = [u[0], u[1]];
  [run.keyframes, run.closures].forEach((list, k) => { list.length = Math.min(list.length, u[k]); });
  run.events = run.events.filter((k) => k < u[1]);
  run.newPoses = run.told = 1;
}, (f, u, i, b, text) => { run.words = text().split("\n"); }];
const read = (data) => {
  const all = new Uint32Array(data);
  if (all[0] !== 0x1574d) return;
  for (let at = 1; at < all.length;) {
    const [kind, length] = all.subarray(at, at + 2), from = 4 * at + 8, words = length >> 2, bytes = new Uint8Array(data, from, length);
    readers[kind]?.(new Float32Array(data, from, words), new Uint32Array(data, from, words), new Int32Array(data, from, words), bytes, () => new TextDecoder().decode(bytes));
    at += 2 + Math.ceil(length / 4);
  }
};
const element = (name, text, kind) => { const made = document.createElement(name); made.textContent = text; if (kind) made.className = kind; return made; };
const time = (s) => `${Math.floor(s / 60)}:${(s % 60).toFixed(1).padStart(4, "0")}`;
const tell = () => {
  const { robot: r } = run;
  if (r) {
    const word = r.joined ? STATUS[r.status] : STATUS[r.status] + ", apart";
    if (id("status").textContent !== word) { id("status").textContent = word; id("status").className = STATUS[r.status]; }
    id("where").textContent = `x ${r.p[0].toFixed(2)} m, y ${r.p[1].toFixed(2)} m, ${time(run.at)}, ${run.totals[0]} keyframes`;
  }
  if (run.can & 2) {
    id("at").textContent = `${time(run.at)} of ${time(run.end)}`;
    if (document.activeElement !== id("time") || !run.dragged) [id("time").max, id("time").value] = [run.end, run.at];
    if (document.activeElement !== id("speed")) {
      const words = String(Math.round(run.speed * 100) / 100);
      if (![...id("speed").options].some((known) => known.value === words)) id("speed").add(new Option(words, words));
      id("speed").value = words;
    }
  }
  press("pause", run.can & 1 ? run.paused : frozen);
  if (run.told) {
    const counts = [0, 0, 0, 0];
    run.closures.forEach((closure) => counts[closure.state]++);
    id("counts").textContent = `${counts[1]} accepted, ${counts[0]} waiting, ${counts[2]} refused` + (counts[3] ? `, ${counts[3]} withdrawn` : "");
    id("events").replaceChildren(...run.events.slice().reverse().map((k) => {
      const { from, to, state, what } = run.closures[k], made = element("li", `${state ? STATES[state] : "proposed"} ${from} → ${to}`, STATES[state]);
      const why = run.words[what >> 8];
      if (why) made.append(element("small", why));
      return made;
    }));
    run.told = 0;
  }
  over.setAttribute("aria-label", `The map: ${id("status").textContent}, ${run.totals[0]} keyframes, ${run.totals[1]} candidates for closures`);
};

// ---- drawing when something changed, and only then is more asked for

let due = 0, hungry = false;
const go = (number) => {
  if (due !== number) return;
  due = -number;
  paint();
  if (hungry && !(frozen && !(run.can & 1))) { hungry = false; ask("ready"); }
};
// A page that nobody sees is given no frames: then once a second will do.
const draw = () => {
  if (due > 0) return;
  const number = due = 1 - due;
  requestAnimationFrame(() => go(number));
  setTimeout(() => go(number), 1000);
};
const ask = (what) => { if (asks && asks.readyState === 1) asks.send(what); };
const connect = () => {
  asks = new WebSocket(`ws://${location.host}/view${location.search}`);
  asks.binaryType = "arraybuffer";
  asks.onopen = () => { forget(); ask("ready"); };
  asks.onmessage = ({ data }) => { read(data); tell(); if (run.robot) run.fresh = false; root.dataset.messages = Number(root.dataset.messages || 0) + 1; hungry = true; draw(); };
  asks.onclose = () => { id("status").textContent = "no connection, trying again"; id("status").className = "lost"; setTimeout(connect, 1500); };
};

// ---- light and dark, keys, pointer

const dark = matchMedia("(prefers-color-scheme: dark)");
const dress = (on) => {
  root.classList.toggle("dark", on);
  const style = getComputedStyle(root), css = (name) => style.getPropertyValue("--" + name).trim();
  const floats = (name) => [1, 3, 5].map((k) => parseInt(css(name).slice(k, k + 2), 16) / 255);
  colours = { css: Object.fromEntries(["way", "rim", "scan", "lost", "degraded", ...STATES].map((name) => [name, css(name)])) };
  for (const name of ["free", "unknown", "wall", "low", "high"]) colours[name] = floats(name);
  draw();
};
on(dark, "change", () => dress(dark.matches));
const pause = () => {
  if (run.can & 1) ask(run.paused ? "resume" : "pause");
  else { frozen = !frozen; press("pause", frozen); draw(); }
};
const turn = (by) => { eye.turn += by; draw(); };
const show = (what) => { shown[what] = !shown[what]; draw(); };
const help = (on = id("help").hidden) => { id("help").hidden = !on; };
const seek = (by) => { if (run.can & 2) ask("seek " + Math.max(0, run.at + by).toFixed(2)); };
const keys = {
  " ": pause, f: () => follow(!eye.follow), "+": () => zoom(1.4), "=": () => zoom(1.4), "-": () => zoom(1 / 1.4), 0: all, d: () => dress(!root.classList.contains("dark")), "?": () => help(), Escape: () => help(false),
  ArrowLeft: () => move(60, 0), ArrowRight: () => move(-60, 0), ArrowUp: () => move(0, 60), ArrowDown: () => move(0, -60), "[": () => turn(0.1), "]": () => turn(-0.1),
  c: () => show("c"), s: () => show("s"), p: () => show("p"), ",": () => seek(-10), ".": () => seek(10),
};
on(document, "keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || !keys[event.key] || event.key !== "Escape" && ["INPUT", "SELECT"].includes(event.target.tagName) || event.key === " " && event.target.tagName === "BUTTON") return;
  event.preventDefault();
  keys[event.key]();
});
for (const button of document.querySelectorAll("[data-key]")) on(button, "click", () => keys[button.dataset.key]());
on(id("time"), "input", () => { run.dragged = true; ask("seek " + Number(id("time").value).toFixed(2)); });
on(id("time"), "change", () => { run.dragged = false; });
on(id("speed"), "change", () => { ask("speed " + id("speed").value); over.focus(); });
on(over, "wheel", (event) => { event.preventDefault(); zoom(Math.exp(-0.0015 * event.deltaY), [event.clientX, event.clientY]); }, { passive: false });
const fingers = new Map();
on(over, "pointerdown", (event) => { over.setPointerCapture(event.pointerId); fingers.set(event.pointerId, [event.clientX, event.clientY]); });
on(over, "pointerup pointercancel", (event) => fingers.delete(event.pointerId));
on(over, "pointermove", (event) => {
  const last = fingers.get(event.pointerId);
  if (!last) return;
  const now = [event.clientX, event.clientY], [dx, dy] = [now[0] - last[0], now[1] - last[1]];
  fingers.set(event.pointerId, now);
  if (fingers.size === 2) {
    const other = [...fingers].find(([known]) => known !== event.pointerId)[1];
    const apart = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) + 1;
    zoom(apart(now) / apart(last), [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2]);
  } else if (run.space && (event.shiftKey || event.buttons & 2)) {
    eye.tilt = Math.min(Math.max(eye.tilt + dy * 0.006, 0.05), Math.PI / 2);
    turn(-dx * 0.006);
  } else move(dx, dy);
});
on(over, "contextmenu", (event) => event.preventDefault());
new ResizeObserver(() => { size = [innerWidth, innerHeight]; draw(); }).observe(root);
size = [innerWidth, innerHeight];
forget();
dress(dark.matches);
connect();
})();
