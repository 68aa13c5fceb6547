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
  const { RAD, css, fixed, colourOf, context, planOf, scaleBar, curve, robot, ellipse, dot, cross } = drawing;
  const FULL_RUN_MS = 25000;
  let now = 0, shownFrame = -2, played = 0;

  const method = () => data.methods[choice.value];
  const frameAt = data.frames.map((frame) => frame.at);

  const path = (g, poses, place) =>
    curve(g, now + 1, (i) => poses.x[i] === null ? null : place(poses.x[i], poses.y[i]));

  function drawPlan() {
    const [g, width, height] = context(plan);
    if (!width) return;
    const [x0, y0, x1, y1] = data.box, [scale, place] = planOf(data.box, width, height);
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
    for (const [x, y] of data.true_points) {
      const [u, v] = place(x, y);
      g.beginPath();
      g.moveTo(u, v - 6); g.lineTo(u + 5, v + 3); g.lineTo(u - 5, v + 3);
      g.closePath();
      g.stroke();
    }
    if (data.truth) {
      g.lineWidth = 3;
      path(g, data.truth, place);
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
    for (const [number, first, x, y] of m.points) {
      if (first > data.node[now]) continue;
      const bright = fresh.has(number), [u, v] = place(x, y);
      g.globalAlpha = bright ? 1 : 0.65;
      dot(g, u, v, bright ? 4.5 : 3);
      if (bright) g.fillText(number, u + 7, v - 5);
    }
    g.globalAlpha = 1;
    g.lineWidth = 1.8;
    path(g, m, place);
    const [u, v] = place(m.x[now], m.y[now]);
    robot(g, u, v, m.theta[now] * RAD, 7);
    g.strokeStyle = css("--ink");
    g.lineWidth = 1.2;
    ellipse(g, u, v, m, now, scale);
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
    ellipse(g, u, v, m, now, scale);
    dot(g, u, v, 2.5);
    if (off && away < 6.5 * half) {
      const [tu, tv] = [u + off[0] * scale, v - off[1] * scale];
      g.strokeStyle = g.fillStyle = css("--ink");
      cross(g, tu, tv);
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
      [`${data.several} so far`, String([...m.lines, ...m.points].filter((l) => l[1] <= data.node[now]).length)],
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
    const frame = drawing.last(frameAt, now);
    if (redraw || frame !== shownFrame) { shownFrame = frame; drawFrame(); }
    drawPlan(); drawZoom(); tell();
  }

  function begin() {
    if (now >= data.t.length - 1) go(0, false);
    played = data.t[now];
  }

  const { stop } = drawing.clock(button, "Stop", begin, (ms) => {
    const end = data.t.length - 1;
    played += ms / FULL_RUN_MS * data.t[end];
    const step = Math.max(now, drawing.last(data.t, played));
    if (step !== now) go(step, false);
    return step >= end;
  });

  data.methods.forEach((m, i) => choice.append(new Option(m.name, i)));
  choice.value = data.methods.length - 1;
  slider.max = data.t.length - 1;
  slider.addEventListener("input", () => { stop(); go(+slider.value, false); });
  choice.addEventListener("change", () => go(now, true));
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
