"use strict";
// The replay: the frame with its lines, the plan so far and the covariance at one moment.
(() => {
  const source = document.getElementById("replay-data");
  if (!source) return;
  const data = JSON.parse(source.textContent);
  const find = (id) => document.getElementById("replay-" + id);
  const slider = find("slider"), choice = find("method"), button = find("play");
  const plan = find("plan"), zoom = find("zoom"), picture = find("picture");
  const SVG = "http://www.w3.org/2000/svg";
  const RAD = Math.PI / 180;
  const FULL_RUN_MS = 25000;
  let now = 0, shownFrame = -2, playing = 0;

  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const colourOf = (method) => {
    const name = /var\((.*)\)/.exec(method.colour);
    return name ? css(name[1]) : method.colour;
  };
  const method = () => data.methods[choice.value];
  const fixed = (value, digits) => value.toFixed(digits).replace("-", "−");

  function context(canvas) {
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const g = canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.lineJoin = "round";
    g.font = "12px system-ui, sans-serif";
    return [g, width, height];
  }

  // A length of 1, 2 or 5 times a power of ten, at most `most`.
  function roundLength(most) {
    const power = 10 ** Math.floor(Math.log10(most));
    return [5, 2, 1].map((n) => n * power).find((n) => n <= most * 1.0000001) || power;
  }

  const metres = (m) => m >= 1 ? `${m} m` : m >= 1e-3 ? `${Math.round(m * 1e3)} mm` : `${+(m * 1e3).toPrecision(1)} mm`;

  function scaleBar(g, width, height, pixelsPerMetre) {
    const length = roundLength((0.3 * width) / pixelsPerMetre);
    const x = 10, y = height - 10;
    g.strokeStyle = g.fillStyle = css("--ink");
    g.lineWidth = 1.5;
    g.setLineDash([]);
    g.beginPath();
    g.moveTo(x, y - 4); g.lineTo(x, y); g.lineTo(x + length * pixelsPerMetre, y);
    g.lineTo(x + length * pixelsPerMetre, y - 4);
    g.stroke();
    g.fillText(metres(length), x + 4, y - 6);
  }

  function curve(g, poses, last, place) {
    g.beginPath();
    let pen = false;
    for (let i = 0; i <= last; i++) {
      if (poses.x[i] === null) { pen = false; continue; }
      const [u, v] = place(poses.x[i], poses.y[i]);
      if (pen) g.lineTo(u, v); else g.moveTo(u, v);
      pen = true;
    }
    g.stroke();
  }

  function robot(g, u, v, theta, size) {
    const c = Math.cos(theta), s = Math.sin(theta);
    const at = (a, b) => [u + size * (a * c - b * s), v - size * (a * s + b * c)];
    g.beginPath();
    g.moveTo(...at(1.3, 0)); g.lineTo(...at(-0.8, 0.75)); g.lineTo(...at(-0.8, -0.75));
    g.closePath();
    g.fill();
  }

  function ellipse(g, u, v, m, scale) {
    g.beginPath();
    const [a, b] = [m.half[0][now], m.half[1][now]];
    g.ellipse(u, v, Math.max(a * scale, 0.5), Math.max(b * scale, 0.5), -m.angle[now] * RAD, 0, 2 * Math.PI);
    g.stroke();
  }

  function drawPlan() {
    const [g, width, height] = context(plan);
    if (!width) return;
    const [x0, y0, x1, y1] = data.box;
    const scale = Math.min((width - 24) / (x1 - x0), (height - 24) / (y1 - y0));
    const place = (x, y) => [
      width / 2 + scale * (x - (x0 + x1) / 2), height / 2 - scale * (y - (y0 + y1) / 2)];
    const m = method(), colour = colourOf(m), frame = data.frames[shownFrame];
    const fresh = frame && frame.at === now ? new Set(frame.lines.map((l) => l[4 + +choice.value])) : new Set();
    const reach = Math.hypot(x1 - x0, y1 - y0);

    g.strokeStyle = css("--ink");
    g.globalAlpha = 0.3;
    g.setLineDash([5, 4]);
    for (const [rho, alpha] of data.true_lines) {
      const c = Math.cos(alpha * RAD), s = Math.sin(alpha * RAD);
      const middle = -(x0 + x1) / 2 * s + (y0 + y1) / 2 * c;
      g.beginPath();
      for (const along of [middle - reach, middle + reach])
        g.lineTo(...place(rho * c - along * s, rho * s + along * c));
      g.stroke();
    }
    g.setLineDash([]);
    if (data.truth) {
      g.lineWidth = 3;
      curve(g, data.truth, now, place);
    }
    g.globalAlpha = 1;
    g.strokeStyle = g.fillStyle = colour;
    for (const [number, first, ax, ay, bx, by] of m.lines) {
      if (first > data.node[now]) continue;
      const bright = fresh.has(number);
      g.lineWidth = bright ? 3.5 : 1.2;
      g.globalAlpha = bright ? 1 : 0.65;
      g.beginPath();
      g.moveTo(...place(ax, ay)); g.lineTo(...place(bx, by));
      g.stroke();
      if (bright) {
        const [u, v] = place((ax + bx) / 2, (ay + by) / 2);
        g.fillText(number, u + 5, v - 5);
      }
    }
    g.globalAlpha = 1;
    g.lineWidth = 1.8;
    curve(g, m, now, place);
    const [u, v] = place(m.x[now], m.y[now]);
    robot(g, u, v, m.theta[now] * RAD, 7);
    g.strokeStyle = css("--ink");
    g.lineWidth = 1.2;
    ellipse(g, u, v, m, scale);
    scaleBar(g, width, height, scale);
  }

  function error() {
    if (!data.truth || data.truth.x[now] === null) return null;
    const m = method();
    return [data.truth.x[now] - m.x[now], data.truth.y[now] - m.y[now]];
  }

  function drawZoom() {
    const [g, width, height] = context(zoom);
    if (!width) return;
    const m = method(), off = error();
    const away = off ? Math.hypot(...off) : 0;
    const half = Math.max(m.half[0][now], Math.min(away, 6 * m.half[0][now]), 1e-5) * 1.25;
    const scale = Math.min(width, height) / 2 / half;
    const u = width / 2, v = height / 2;
    g.strokeStyle = css("--rule");
    g.beginPath();
    g.moveTo(0, v); g.lineTo(width, v); g.moveTo(u, 0); g.lineTo(u, height);
    g.stroke();
    g.strokeStyle = g.fillStyle = colourOf(m);
    g.lineWidth = 2;
    ellipse(g, u, v, m, scale);
    g.beginPath();
    g.arc(u, v, 2.5, 0, 2 * Math.PI);
    g.fill();
    if (off && away < 6.5 * half) {
      const [tu, tv] = [u + off[0] * scale, v - off[1] * scale];
      g.strokeStyle = g.fillStyle = css("--ink");
      g.beginPath();
      g.moveTo(tu - 5, tv - 5); g.lineTo(tu + 5, tv + 5);
      g.moveTo(tu - 5, tv + 5); g.lineTo(tu + 5, tv - 5);
      g.stroke();
      g.fillText("truth", Math.min(tu + 8, width - 32), Math.max(tv - 6, 12));
    }
    scaleBar(g, width, height, scale);
  }

  function element(name, attributes) {
    const made = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    return made;
  }

  function drawFrame() {
    if (!data.frames.length) return;
    const frame = data.frames[shownFrame];
    picture.replaceChildren();
    find("file").textContent = frame ? `${frame.name}, ${fixed(data.t[frame.at], 2)} s` : "no image yet";
    if (!frame) return;
    const [width, height] = frame.size;
    picture.setAttribute("viewBox", `0 0 ${width} ${height}`);
    picture.append(element("image", { width, height, href: "data:image/jpeg;base64," + frame.jpeg }));
    for (const line of frame.lines) {
      const [x1, y1, x2, y2] = line, number = line[4 + +choice.value];
      const kind = number < 0 ? "left" : "taken";
      const drawn = { x1, y1, x2, y2, class: kind, style: `--c: ${method().colour}` };
      picture.append(element("line", { ...drawn, class: "under" }), element("line", drawn));
      if (number < 0) continue;
      const x = Math.min((x1 + x2) / 2 + 3, width - 14), y = Math.max((y1 + y2) / 2 - 3, 10);
      const text = element("text", { x, y });
      text.textContent = number;
      picture.append(text);
    }
  }

  function tell() {
    const m = method(), off = error();
    const [a, b] = [m.half[0][now], m.half[1][now]].map((h) => (1e3 * h).toPrecision(3));
    const facts = [
      ["time", `${fixed(data.t[now], 2)} s`],
      ["node", `${data.node[now]} of 0 to ${data.nodes - 1}`],
      ["position", `${fixed(m.x[now], 3)} m, ${fixed(m.y[now], 3)} m`],
      ["heading", `${fixed(m.theta[now], 1)}°`],
      ["95 % ellipse, half axes", `${+a} mm, ${+b} mm`],
      ["95 % of heading", `± ${+m.heading95[now].toPrecision(3)}°`],
      ["lines so far", String(m.lines.filter((line) => line[1] <= data.node[now]).length)],
    ];
    if (off) facts.push(["error of position", `${+(1e3 * Math.hypot(...off)).toPrecision(3)} mm`]);
    find("facts").replaceChildren(...facts.map(([label, value]) => {
      const row = document.createElement("div");
      const term = document.createElement("dt"), text = document.createElement("dd");
      term.textContent = label; text.textContent = value;
      row.append(term, text);
      return row;
    }));
    slider.setAttribute("aria-valuetext", `${fixed(data.t[now], 2)} seconds, node ${data.node[now]}`);
  }

  function go(step, redraw) {
    now = Math.max(0, Math.min(data.t.length - 1, step));
    slider.value = now;
    let frame = -1;
    for (let i = 0, j = data.frames.length; i < j;) { // the last frame that is not in the future
      const middle = (i + j) >> 1;
      if (data.frames[middle].at <= now) { frame = middle; i = middle + 1; } else j = middle;
    }
    if (redraw || frame !== shownFrame) { shownFrame = frame; drawFrame(); }
    drawPlan(); drawZoom(); tell();
  }

  function stop() {
    cancelAnimationFrame(playing);
    playing = 0;
    button.textContent = "Play";
  }

  function play() {
    if (playing) return stop();
    button.textContent = "Stop";
    const last = data.t.length - 1;
    const from = now >= last ? 0 : now, began = performance.now();
    const tick = (time) => {
      const t = data.t[from] + Math.max(0, time - began) / FULL_RUN_MS * data.t[last];
      let step = now;
      while (step < last && data.t[step + 1] <= t) step++;
      if (step !== now) go(step, false);
      if (step >= last) return stop();
      playing = requestAnimationFrame(tick);
    };
    if (now !== from) go(from, false);
    playing = requestAnimationFrame(tick);
  }

  data.methods.forEach((m, i) => choice.append(new Option(m.name, i)));
  choice.value = data.methods.length - 1;
  slider.max = data.t.length - 1;
  slider.addEventListener("input", () => { stop(); go(+slider.value, false); });
  choice.addEventListener("change", () => go(now, true));
  button.addEventListener("click", play);
  for (const link of document.querySelectorAll("a[data-node]"))
    link.addEventListener("click", () => {
      stop();
      const index = data.node.findIndex((node) => node >= +link.dataset.node);
      const which = data.methods.findIndex((m) => m.name === link.dataset.method);
      if (which >= 0) choice.value = which;
      go(index < 0 ? data.t.length - 1 : index, true);
    });
  const again = () => go(now, true);
  new ResizeObserver(again).observe(plan);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  find("note").hidden = true;
  find("player").hidden = false;
  go(data.frames.length ? data.frames[Math.floor(data.frames.length / 2)].at : data.t.length >> 1, true);
})();
