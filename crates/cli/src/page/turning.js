// Maps of space that can be turned: WebGL, the map's points as told in the page, no library.
(() => {
  "use strict";
  const data = JSON.parse(document.getElementById("data").textContent);

  const POINTS = `
    attribute vec3 place; attribute float colour;
    uniform vec3 low, step, eye, right, up, ahead; uniform vec2 scale, planes; uniform float size, cut, fixed_px; uniform vec3 tint; uniform vec4 storeys[9];
    varying vec3 shown;
    void main() {
      vec3 metres = low + step * place, shift = vec3(0.0);
      for (int k = 0; k < 9; k += 1) if (metres.z >= storeys[k].w) shift = storeys[k].xyz;
      metres += shift;
      vec3 at = metres - eye;
      float depth = dot(ahead, at);
      float z = (planes.y + planes.x) / (planes.y - planes.x) * depth - 2.0 * planes.x * planes.y / (planes.y - planes.x);
      gl_Position = vec4(scale.x * dot(right, at), scale.y * dot(up, at), z, depth);
      gl_PointSize = fixed_px > 0.0 ? fixed_px : clamp(size / max(depth, 0.001), 1.5, 64.0);
      if (metres.z > cut) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
      shown = fixed_px > 0.0 ? tint : vec3(floor(colour / 2048.0) / 31.0, floor(mod(colour, 2048.0) / 32.0) / 63.0, mod(colour, 32.0) / 31.0);
    }`;
  const FRAGMENT = `
    precision mediump float; varying vec3 shown; uniform float round;
    void main() {
      if (round > 0.5 && length(gl_PointCoord - vec2(0.5)) > 0.5) discard;
      gl_FragColor = vec4(shown, 1.0);
    }`;
  const VIEW_ANGLE = 0.7; // half the height of the view as a tangent
  const STEEPEST = 1.5607; // just below 90 degrees, radians
  const STOREYS = 9; // above the lowest, at most: each holds a tenth of the way
  const COLUMNS = 3; // storeys beside each other; more begin another row
  const APART = 1.08; // from one to the next, of its size
  const TINTS = { way: [0, 0.447, 0.698], rim: [1, 1, 1], start: [0, 0.44, 0.31], end: [0.7, 0.15, 0.12], closure: [0.88, 0.48, 0.06] };

  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));

  function program(gl) {
    const made = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, POINTS], [gl.FRAGMENT_SHADER, FRAGMENT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    return gl.getProgramParameter(made, gl.LINK_STATUS) ? made : null;
  }

  class Turning {
    constructor(figure, told) {
      this.figure = figure;
      this.told = told;
      this.canvas = figure.querySelector("canvas");
      this.gl = this.canvas.getContext("webgl", { antialias: true, preserveDrawingBuffer: true }); // kept, so that it can be printed and saved
      this.program = this.gl && program(this.gl);
      if (!this.program) return;
      this.upload();
      this.captions = (told.storeys.length > 1 ? told.storeys : []).map((_, k) => {
        const caption = document.createElement("span");
        caption.className = "caption";
        caption.textContent = `storey ${k + 1} of ${told.storeys.length}`;
        caption.hidden = true;
        figure.querySelector(".turning-tools").before(caption);
        return caption;
      });
      this.apart = false;
      figure.querySelector("[data-turn=storeys]")?.setAttribute("aria-pressed", "false");
      this.frame();
      this.listen();
      this.canvas.hidden = false;
      figure.querySelector(".turning-tools").hidden = false;
      new ResizeObserver(() => this.ask()).observe(this.canvas);
      this.ask();
    }

    works() { return Boolean(this.program); }

    upload() {
      const { gl, told } = this;
      const buffer = (content) => {
        const made = gl.createBuffer();
        gl.bindBuffer(gl.ARRAY_BUFFER, made);
        gl.bufferData(gl.ARRAY_BUFFER, content, gl.STATIC_DRAW);
        return made;
      };
      const [points, places, closures] = [told.points, told.way, told.closures].map(bytes);
      const way = this.dense(places);
      this.counts = { points: points.length / 8, way: Math.floor(way.length / 6), closures: Math.floor(closures.length / 6) };
      this.buffers = { points: buffer(points), way: buffer(way), closures: buffer(closures) };
      this.at = Object.fromEntries(["place", "colour"].map((name) => [name, gl.getAttribLocation(this.program, name)]));
      const names = ["low", "step", "eye", "right", "up", "ahead", "scale", "planes", "size", "cut", "fixed_px", "tint", "round", "storeys"];
      this.uniforms = Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(this.program, name)]));
    }

    // The way with places between its own, so close that their dots make a line.
    dense(bytes) {
      const { step, frame: [low, high] } = this.told;
      const apart = Math.hypot(...[0, 1, 2].map((k) => high[k] - low[k])) / 1200;
      const view = new DataView(bytes.buffer);
      const at = (number) => [0, 2, 4].map((k) => view.getUint16(6 * number + k, true));
      const made = [];
      for (let number = 0; 6 * number + 5 < bytes.length; number += 1) {
        const to = at(number);
        const from = number > 0 ? at(number - 1) : to;
        const length = Math.hypot(...[0, 1, 2].map((k) => (to[k] - from[k]) * step[k]));
        const parts = Math.min(Math.max(Math.ceil(length / apart), 1), 100);
        for (let part = 1; part <= parts; part += 1) made.push(...[0, 1, 2].map((k) => from[k] + ((to[k] - from[k]) * part) / parts));
      }
      return new Uint8Array(Uint16Array.from(made, Math.round).buffer);
    }

    // How far each storey is shifted, and where what is shown then begins and ends. Beside each other the robot drives at the same height in all.
    arranged() {
      const { frame: [low, high], storeys } = this.told;
      if (!this.apart) return { shifts: storeys.map(() => [0, 0, 0]), low, high };
      const next = [0, 1].map((k) => APART * (high[k] - low[k]));
      const shifts = storeys.map(([, level], k) => [(k % COLUMNS) * next[0], -Math.floor(k / COLUMNS) * next[1], storeys[0][1] - level]);
      const top = storeys.map((_, k) => (k + 1 < storeys.length ? storeys[k + 1][0] : high[2]) + shifts[k][2]);
      const [right, front] = [Math.max(...shifts.map((shift) => shift[0])), Math.min(...shifts.map((shift) => shift[1]))];
      return { shifts, low: [low[0], low[1] + front, low[2]], high: [high[0] + right, high[1], Math.max(...top)] };
    }

    // What is turned about, how large it is, and the heights that can be cut off.
    frame() {
      const { low, high, shifts } = this.arranged();
      this.shifts = shifts;
      this.middle = [0, 1, 2].map((k) => (low[k] + high[k]) / 2);
      this.reach = Math.max(0.5 * Math.hypot(...[0, 1, 2].map((k) => high[k] - low[k])), 0.01);
      const range = this.figure.querySelector("input[type=range]");
      [range.min, range.max, range.step] = [low[2], high[2], "any"];
      const above = (this.apart ? this.told.storeys[0][1] : this.told.highest) + 1.5;
      this.cut = this.told.highest !== null && above < high[2] ? above : high[2];
      range.value = this.cut;
      this.reset();
      this.tellCut();
    }

    reset() { Object.assign(this, { target: [...this.middle], yaw: 0.5, pitch: 0.75, distance: 1.05 * this.reach / VIEW_ANGLE }); }

    tellCut() {
      const range = this.figure.querySelector("input[type=range]");
      this.cut = Number(range.value) >= Number(range.max) ? 1e9 : Number(range.value);
      const words = this.cut > 1e8 ? "all" : `${Number(range.value).toFixed(1)} m`;
      this.figure.querySelector(".cut").textContent = words;
      range.setAttribute("aria-valuetext", words);
    }

    // Directions of the view: to the right, up and ahead.
    axes() {
      const [s, c, t, d] = [Math.sin(this.yaw), Math.cos(this.yaw), Math.sin(this.pitch), Math.cos(this.pitch)];
      return { right: [c, s, 0], ahead: [-s * d, c * d, -t], up: [-s * t, c * t, d] };
    }

    ask() {
      if (this.asked) return;
      this.asked = true;
      requestAnimationFrame(() => { this.asked = false; this.draw(); });
    }

    draw() {
      const { gl, canvas, told, uniforms } = this;
      const ratio = Math.min(window.devicePixelRatio || 1, 2);
      const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(Math.round(side * ratio), 1));
      if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
      gl.viewport(0, 0, width, height);
      const dark = matchMedia("(prefers-color-scheme: dark)").matches;
      gl.clearColor(...(dark ? [0.2, 0.22, 0.25] : [0.77, 0.81, 0.86]), 1);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.useProgram(this.program);
      const axes = this.axes();
      const eye = [0, 1, 2].map((k) => this.target[k] - this.distance * axes.ahead[k]);
      const far = this.distance + 4 * this.reach;
      for (const [name, value] of Object.entries({ low: told.low, step: told.step, eye, ...axes })) gl.uniform3fv(uniforms[name], value);
      gl.uniform2f(uniforms.scale, height / width / VIEW_ANGLE, 1 / VIEW_ANGLE);
      gl.uniform2f(uniforms.planes, Math.max(0.002 * this.distance, 1e-3), far);
      gl.uniform1f(uniforms.size, 1.5 * told.point * height / (2 * VIEW_ANGLE));
      gl.uniform1f(uniforms.cut, this.cut);
      const begins = Array.from({ length: STOREYS }, (_, k) => (this.apart && told.storeys[k + 1] ? told.storeys[k + 1][0] : 1e9));
      gl.uniform4fv(uniforms.storeys, begins.flatMap((begin, k) => [...(this.shifts[k + 1] || [0, 0, 0]), begin]));
      gl.enable(gl.DEPTH_TEST);
      this.bind("points", 8);
      gl.uniform1f(uniforms.fixed_px, 0);
      gl.uniform1f(uniforms.round, 0);
      gl.drawArrays(gl.POINTS, 0, this.counts.points);
      this.drawLines(ratio);
      this.placeCaptions(axes, eye);
      canvas.dataset.drawn = `${this.counts.points},${this.counts.way}`;
    }

    // Each before the front edge of its storey's floor.
    placeCaptions(axes, eye) {
      const { canvas, told: { frame: [low, high] } } = this;
      this.captions.forEach((caption, k) => {
        const at = [(low[0] + high[0]) / 2, low[1], low[2]].map((v, axis) => v + this.shifts[k][axis] - eye[axis]);
        const along = (axis) => axis.reduce((sum, v, n) => sum + v * at[n], 0);
        const depth = VIEW_ANGLE * along(axes.ahead);
        caption.hidden = !this.apart || depth <= 0;
        caption.style.left = `${canvas.clientWidth / 2 + (canvas.clientHeight / 2) * (along(axes.right) / depth)}px`;
        caption.style.top = `${(canvas.clientHeight / 2) * (1 - along(axes.up) / depth)}px`;
      });
    }

    bind(name, stride) {
      const { gl, at } = this;
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name]);
      gl.enableVertexAttribArray(at.place);
      gl.vertexAttribPointer(at.place, 3, gl.UNSIGNED_SHORT, false, stride, 0);
      if (stride === 8) {
        gl.enableVertexAttribArray(at.colour);
        gl.vertexAttribPointer(at.colour, 1, gl.UNSIGNED_SHORT, false, stride, 6);
      } else {
        gl.disableVertexAttribArray(at.colour);
      }
    }

    // The way and the closures, over everything: a map hides what it was made from.
    drawLines(ratio) {
      const { gl, uniforms, counts } = this;
      const draw = (mode, first, count, tint, px) => {
        gl.uniform1f(uniforms.fixed_px, px * ratio);
        gl.uniform1f(uniforms.round, mode === gl.POINTS ? 1 : 0);
        gl.uniform3fv(uniforms.tint, TINTS[tint]);
        gl.drawArrays(mode, first, count);
      };
      gl.disable(gl.DEPTH_TEST);
      gl.uniform1f(uniforms.cut, 1e9);
      if (counts.way > 0) {
        this.bind("way", 6);
        draw(gl.POINTS, 0, counts.way, "rim", 6);
        draw(gl.LINE_STRIP, 0, counts.way, "way", 1);
        draw(gl.POINTS, 0, counts.way, "way", 3.5);
        draw(gl.POINTS, 0, 1, "rim", 15);
        draw(gl.POINTS, 0, 1, "start", 12);
        draw(gl.POINTS, counts.way - 1, 1, "rim", 15);
        draw(gl.POINTS, counts.way - 1, 1, "end", 12);
      }
      if (counts.closures > 0) {
        this.bind("closures", 6);
        draw(gl.LINES, 0, counts.closures, "closure", 1);
      }
    }

    turn(yaw, pitch) {
      this.yaw = (this.yaw + yaw) % (2 * Math.PI);
      this.pitch = Math.min(Math.max(this.pitch + pitch, -STEEPEST), STEEPEST);
      this.changed();
    }

    zoom(factor) {
      this.distance = Math.min(Math.max(this.distance / factor, 0.01 * this.reach), 8 * this.reach / VIEW_ANGLE);
      this.changed();
    }

    // By shares of the view's height.
    move(x, y) {
      const axes = this.axes();
      const length = 2 * VIEW_ANGLE * this.distance;
      this.target = this.target.map((v, k) => v + length * (x * axes.right[k] + y * axes.up[k]));
      this.changed();
    }

    changed() {
      const degrees = (angle) => Math.round(angle * 180 / Math.PI);
      this.figure.querySelector(".at").textContent = `seen from ${degrees(this.pitch)}° above, turned by ${((degrees(this.yaw) % 360) + 360) % 360}°${this.apart ? ", storeys beside each other" : ""}`;
      this.ask();
    }

    act(what) {
      if (what === "in") this.zoom(1.3);
      else if (what === "out") this.zoom(1 / 1.3);
      else if (what === "above") { this.pitch = STEEPEST; this.yaw = 0; this.changed(); }
      else if (what === "side") { this.pitch = 0; this.yaw = 0; this.changed(); }
      else if (what === "storeys") this.part();
      else { this.reset(); this.changed(); }
    }

    // Storeys beside each other, or back; seen from the same side.
    part() {
      if (this.captions.length === 0) return;
      const { yaw, pitch } = this;
      this.apart = !this.apart;
      this.figure.querySelector("[data-turn=storeys]")?.setAttribute("aria-pressed", this.apart);
      this.frame();
      Object.assign(this, { yaw, pitch });
      this.changed();
    }

    key(event) {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const step = Math.PI / 18;
      const turns = { ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
      const moves = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
      const acts = { "+": "in", "=": "in", "-": "out", "0": "all", s: "storeys" };
      if (turns[event.key] && event.shiftKey) this.move(...moves[event.key]);
      else if (turns[event.key]) this.turn(...turns[event.key]);
      else if (acts[event.key]) this.act(acts[event.key]);
      else return;
      event.preventDefault();
    }

    listen() {
      const { canvas, figure } = this;
      canvas.addEventListener("keydown", (event) => this.key(event));
      for (const button of figure.querySelectorAll("[data-turn]")) {
        button.addEventListener("click", () => this.act(button.dataset.turn));
      }
      figure.querySelector("input[type=range]").addEventListener("input", () => { this.tellCut(); this.ask(); });
      canvas.addEventListener("wheel", (event) => {
        if (!event.ctrlKey && !event.metaKey && document.activeElement !== canvas) return;
        event.preventDefault();
        this.zoom(Math.exp(-0.0015 * event.deltaY));
      }, { passive: false });
      canvas.addEventListener("contextmenu", (event) => event.preventDefault());
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.ask());
      canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
      canvas.addEventListener("webglcontextrestored", () => { this.program = program(this.gl); this.upload(); this.ask(); });
      this.listenToPointers();
    }

    // One finger or the mouse turns; the right button, Shift or two fingers move; two fingers enlarge.
    listenToPointers() {
      const { canvas } = this;
      const down = new Map();
      canvas.addEventListener("pointerdown", (event) => {
        down.set(event.pointerId, [event.clientX, event.clientY]);
        canvas.setPointerCapture(event.pointerId);
        canvas.focus({ preventScroll: true });
      });
      canvas.addEventListener("pointermove", (event) => {
        const from = down.get(event.pointerId);
        if (!from) return;
        const now = [event.clientX, event.clientY];
        const [dx, dy] = [now[0] - from[0], now[1] - from[1]].map((px) => px / Math.max(canvas.clientHeight, 1));
        const other = [...down].filter(([id]) => id !== event.pointerId).map(([, at]) => at)[0];
        down.set(event.pointerId, now);
        if (other) {
          const [before, after] = [from, now].map((at) => Math.hypot(at[0] - other[0], at[1] - other[1]));
          if (before > 0 && after > 0) this.zoom(after / before);
          this.move(-dx / 2, dy / 2);
        } else if (event.shiftKey || (event.buttons & 2) !== 0) {
          this.move(-dx, dy);
        } else {
          this.turn(-Math.PI * dx, Math.PI * dy);
        }
      });
      for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (event) => down.delete(event.pointerId));
    }
  }

  for (const figure of document.querySelectorAll("figure.turning")) {
    const told = (data[figure.dataset.run] || {}).turning || {};
    const own = told[figure.dataset.map];
    const turning = own && new Turning(figure, own);
    if (turning && turning.works()) continue;
    figure.querySelector("figcaption").textContent = "This browser shows no WebGL: the map cannot be turned here. The picture below shows it.";
    figure.querySelector(".frame").hidden = true;
  }
})();
