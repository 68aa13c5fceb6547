"use strict";
// What the pages that play a log share: canvases, what is drawn on them, and the clock.
const drawing = (() => {
  const RAD = Math.PI / 180;
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const fixed = (value, digits) => value.toFixed(digits).replace("-", "−");

  function colourOf(track) {
    const name = /var\((.*)\)/.exec(track.colour);
    return name ? css(name[1]) : track.colour;
  }

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

  // Pixels for a metre, and where on the plan a place is.
  function planOf(box, width, height) {
    const [x0, y0, x1, y1] = box;
    const scale = Math.min((width - 24) / (x1 - x0), (height - 24) / (y1 - y0));
    const place = (x, y) => [
      width / 2 + scale * (x - (x0 + x1) / 2), height / 2 - scale * (y - (y0 + y1) / 2)];
    return [scale, place];
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

  // A curve through the first `count` points; where at(i) is null it breaks off.
  function curve(g, count, at) {
    g.beginPath();
    let pen = false;
    for (let i = 0; i < count; i++) {
      const point = at(i);
      if (!point) { pen = false; continue; }
      if (pen) g.lineTo(...point); else g.moveTo(...point);
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

  function ellipse(g, u, v, track, node, scale) {
    const [a, b] = [track.half[0][node], track.half[1][node]];
    g.beginPath();
    g.ellipse(u, v, Math.max(a * scale, 0.5), Math.max(b * scale, 0.5), -track.angle[node] * RAD, 0, 2 * Math.PI);
    g.stroke();
  }

  function dot(g, u, v, radius) {
    g.beginPath();
    g.arc(u, v, radius, 0, 2 * Math.PI);
    g.fill();
  }

  function cross(g, u, v) {
    g.beginPath();
    g.moveTo(u - 5, v - 5); g.lineTo(u + 5, v + 5);
    g.moveTo(u - 5, v + 5); g.lineTo(u + 5, v - 5);
    g.stroke();
  }

  // The last of increasing values that is not above x, or -1.
  function last(values, x) {
    let low = 0, high = values.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (values[middle] <= x) low = middle + 1; else high = middle;
    }
    return low - 1;
  }

  // A button that plays and stops. step(ms), told how long ago it was called before, says when it is over.
  function clock(button, word, begin, step) {
    let playing = 0;
    function stop() {
      cancelAnimationFrame(playing);
      playing = 0;
      button.textContent = "Play";
    }
    function play() {
      if (playing) return stop();
      button.textContent = word;
      let before = performance.now();
      const tick = (time) => {
        const over = step(Math.max(0, time - before));
        before = time;
        if (over) return stop();
        playing = requestAnimationFrame(tick);
      };
      begin();
      playing = requestAnimationFrame(tick);
    }
    button.addEventListener("click", play);
    return { play, stop };
  }

  return { RAD, css, fixed, colourOf, context, planOf, scaleBar, curve, robot, ellipse, dot, cross, last, clock };
})();
