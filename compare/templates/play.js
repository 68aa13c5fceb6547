"use strict";
// Plays a log: the last image of each camera with what was seen in it, paths so far, covariances.
(() => {
  const find = (id) => document.getElementById("play-" + id);
  const data = JSON.parse(find("data").textContent);
  const slider = find("slider"), button = find("button"), speed = find("speed");
  const plan = find("plan"), zoom = find("zoom"), rows = find("methods").tBodies[0];
  const { RAD, css, fixed, colourOf, context, planOf, scaleBar, curve, robot, ellipse, dot, cross } = drawing;
  const END = data.t[data.t.length - 1], last = (times, t) => drawing.last(times, t + 1e-9);
  const three = (value) => +value.toPrecision(3);
  let now = 0;
  const hidden = new Set();

  function drawPlan(node) {
    const [g, width, height] = context(plan), [scale, place] = planOf(data.box, width, height);
    if (data.truth) {
      g.strokeStyle = css("--ink"); g.globalAlpha = 0.25; g.lineWidth = 5;
      curve(g, node + 1, (i) => data.truth[i][0] === null ? null : place(...data.truth[i]));
      g.globalAlpha = 1;
    }
    const shown = data.tracks.filter((t) => !hidden.has(t.name)), paths = shown.filter((t) => !t.dots);
    for (const track of shown) {
      g.strokeStyle = colourOf(track); g.lineWidth = 1.2; g.globalAlpha = 0.5;
      for (const [first, ax, ay, bx, by] of track.lines) {
        if (first > node) continue;
        g.beginPath(); g.moveTo(...place(ax, ay)); g.lineTo(...place(bx, by)); g.stroke();
      }
      g.globalAlpha = 1;
    }
    paths.forEach((track, k) => {
      g.strokeStyle = g.fillStyle = colourOf(track);
      g.lineWidth = k === paths.length - 2 ? 4.5 : 1.8; // the last path hides none
      curve(g, node + 1, (i) => place(track.x[i], track.y[i]));
    });
    for (const track of shown.filter((t) => t.dots)) {
      g.fillStyle = colourOf(track);
      for (const i of track.shown) {
        if (i > node) break;
        dot(g, ...place(track.x[i], track.y[i]), 2.2);
      }
    }
    for (const track of paths) {
      const [u, v] = place(track.x[node], track.y[node]);
      g.fillStyle = colourOf(track);
      robot(g, u, v, track.theta[node] * RAD, 8);
      g.strokeStyle = css("--ink"); g.lineWidth = 1;
      ellipse(g, u, v, track, node, scale);
    }
    scaleBar(g, width, height, scale);
  }

  function drawZoom(node) {
    const [g, width, height] = context(zoom);
    const paths = data.tracks.filter((t) => !t.dots && !hidden.has(t.name));
    if (!paths.length) return;
    const main = paths[paths.length - 1], half = Math.max(main.half[0][node], 1e-5) * 1.6;
    const scale = Math.min(width, height) / 2 / half;
    const place = (x, y) => [width / 2 + scale * (x - main.x[node]), height / 2 - scale * (y - main.y[node])];
    for (const track of paths) {
      g.strokeStyle = g.fillStyle = colourOf(track); g.lineWidth = 2;
      const [u, v] = place(track.x[node], track.y[node]);
      ellipse(g, u, v, track, node, scale);
      dot(g, u, v, 2.5);
    }
    if (data.truth && data.truth[node][0] !== null) {
      g.strokeStyle = css("--ink"); g.lineWidth = 1.5;
      cross(g, ...place(...data.truth[node]));
    }
    scaleBar(g, width, height, scale);
  }

  // ---- images: one canvas for each camera --------------------------------------------------
  const views = data.cameras.map((camera) => {
    const frames = data.frames.filter((f) => f.camera === camera);
    const figure = document.createElement("figure"), canvas = document.createElement("canvas");
    const words = document.createElement("figcaption");
    words.className = "caption";
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `Images of camera ${camera}`);
    figure.append(canvas, words);
    find("images").append(figure);
    return { camera, frames, times: frames.map((f) => f.t), canvas, words, shown: -2 };
  });

  function drawImage(view, again) {
    const k = last(view.times, now);
    if (k === view.shown && !again) return;
    view.shown = k;
    const frame = view.frames[k];
    view.words.textContent = frame
      ? `${view.camera}, ${fixed(frame.t, 2)} s, ${frame.name}: ${frame.note}` : `${view.camera}: no image yet`;
    if (!frame) return;
    const picture = new Image();
    picture.onload = () => {
      if (view.shown !== k) return;
      const [w, h] = frame.size, canvas = view.canvas, g = canvas.getContext("2d");
      canvas.width = w; canvas.height = h;
      g.drawImage(picture, 0, 0);
      g.lineWidth = 2; g.font = "13px system-ui, sans-serif";
      for (const [used, text, ...points] of frame.marks) {
        g.strokeStyle = g.fillStyle = used ? "#2fbf3a" : "#ff7a2f";
        g.beginPath();
        if (points.length === 2) g.arc(points[0], points[1], 7, 0, 2 * Math.PI);
        else for (let i = 0; i < points.length; i += 2) g.lineTo(points[i], points[i + 1]);
        g.stroke();
        if (text) g.fillText(text, points[0] + 9, points[1] - 8);
      }
    };
    picture.src = "data:image/jpeg;base64," + frame.jpeg;
  }

  // ---- the table of methods ----------------------------------------------------------------
  const cells = data.tracks.map((track) => {
    const row = rows.insertRow(), label = document.createElement("label"), box = document.createElement("input");
    box.type = "checkbox"; box.checked = true;
    box.addEventListener("change", () => {
      if (box.checked) hidden.delete(track.name); else hidden.add(track.name);
      draw(true);
    });
    const name = document.createElement("span");
    name.className = "method"; name.style.setProperty("--c", track.colour);
    name.textContent = track.name + (track.causal ? "" : " (whole run)");
    label.append(box, " ", name);
    row.insertCell().append(label);
    return [0, 1, 2, 3].map(() => row.insertCell());
  });

  function tell(node) {
    find("time").textContent = `${fixed(now, 2)} of ${fixed(END, 2)} s`;
    slider.setAttribute("aria-valuetext", `${fixed(now, 2)} seconds`);
    data.tracks.forEach((track, k) => {
      const unseen = track.dots && !track.shown.includes(node);
      const texts = unseen ? ["not seen", "", "", ""] : [
        `${fixed(track.x[node], 3)}, ${fixed(track.y[node], 3)}`, `${fixed(track.theta[node], 1)}°`,
        `${three(1e3 * track.half[0][node])} × ${three(1e3 * track.half[1][node])}`, `± ${three(track.heading95[node])}°`];
      texts.forEach((text, i) => { cells[k][i].textContent = text; });
    });
  }

  // ---- time --------------------------------------------------------------------------------
  function draw(again) {
    const node = Math.max(0, last(data.t, now));
    for (const view of views) drawImage(view, again);
    drawPlan(node); drawZoom(node); tell(node);
  }

  function seek(t) {
    now = Math.max(0, Math.min(END, t));
    slider.value = now;
    draw(false);
  }

  const { play, stop } = drawing.clock(button, "Pause", () => { if (now >= END) seek(0); }, (ms) => {
    seek(now + ms / 1e3 * +speed.value);
    return now >= END;
  });

  const moves = {
    ArrowLeft: () => data.t[Math.max(0, last(data.t, now - 1e-6))],
    ArrowRight: () => data.t[Math.min(data.t.length - 1, last(data.t, now) + 1)],
    PageUp: () => now - 5, PageDown: () => now + 5, Home: () => 0, End: () => END,
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    if (event.key === " " && event.target.tagName !== "BUTTON" && event.target.type !== "checkbox") play();
    else if (moves[event.key]) { stop(); seek(moves[event.key]()); } else return;
    event.preventDefault();
  });
  slider.max = END;
  slider.addEventListener("input", () => { stop(); seek(+slider.value); });
  new ResizeObserver(() => draw(true)).observe(plan);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => draw(true));
  find("note").hidden = true;
  find("player").hidden = false;
  const asked = /^#t=([\d.]+)$/.exec(location.hash);
  seek(asked ? +asked[1] : 0);
})();
