"use strict";
// Draws each body of the page so that it can be turned. All coordinates are metres; y points away
// from the viewer at azimuth 0, z up. Nothing moves unless the reader moves it.

const FIRST = { azimuth: -35, elevation: 24, zoom: 1, x: 0, y: 0 };
const SHADES = 32; // of each colour of points, from far to near

// Returns columns of numbers from whole steps of 16 bits in base64.
function unpack(packed) {
  const bytes = Uint8Array.from(atob(packed.data), (letter) => letter.charCodeAt(0));
  const columns = packed.middle.length;
  return Float64Array.from(new Int16Array(bytes.buffer),
    (whole, i) => packed.middle[i % columns] + whole * packed.step);
}

const parse = (hex) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16));
const mix = (a, b, t) => `rgb(${a.map((v, i) => Math.round(v + (b[i] - v) * t))})`;

function start(view) {
  const data = JSON.parse(view.querySelector("script").textContent);
  const canvas = view.querySelector("canvas"), pen = canvas.getContext("2d");
  const boxes = [...view.querySelectorAll("input")];
  const layers = Object.entries(data.layers).map(([name, packed]) => [name, unpack(packed)]);
  const rings = [];
  let corner = 0;
  const xy = data.outlines.data ? unpack(data.outlines) : [];
  for (const [section, count] of data.outlines.rings) {
    const own = xy.slice(2 * corner, 2 * (corner + count));
    const mean = [0, 1].map((k) => own.reduce((sum, v, i) => (i % 2 === k ? sum + v : sum), 0) / count);
    rings.push({ section, xy: own, mean });
    corner += count;
  }
  const middle = data.low.map((low, i) => (low + data.high[i]) / 2);
  const [hx, hy, hz] = data.low.map((low, i) => (data.high[i] - low) / 2);
  const radius = Math.hypot(hx, hy, hz) || 1;
  const at = { ...FIRST }, cloud = document.createElement("canvas");
  let colours, project, image, nearest, queued = 0;

  function readColours() {
    const style = getComputedStyle(view);
    colours = (name) => parse(style.getPropertyValue(`--view-${name}`).trim());
    redraw();
  }
  function redraw() {
    queued = queued || requestAnimationFrame(() => { queued = 0; draw(); });
  }

  // Makes `project`: x, y, z -> place on the canvas, depth (-1 near .. 1 far) and pixels per metre.
  function aim(wide, high) {
    const a = at.azimuth * Math.PI / 180, e = at.elevation * Math.PI / 180, e0 = Math.PI * 24 / 180;
    const [ca, sa, ce, se] = [Math.cos(a), Math.sin(a), Math.cos(e), Math.sin(e)];
    const flat = Math.hypot(hx, hy), tall = hz * Math.cos(e0) + flat * Math.sin(e0);
    const fit = 0.41 * Math.min(wide / (flat || radius), high / (tall || radius)) * at.zoom;
    project = (x, y, z) => {
      x -= middle[0]; y -= middle[1]; z -= middle[2];
      const right = x * ca - y * sa, back = x * sa + y * ca;
      const depth = (back * ce - z * se) / radius, scale = fit * 6 / Math.max(6 + depth, 0.2);
      return [wide / 2 + at.x + right * scale, high / 2 + at.y - (z * ce + back * se) * scale,
        depth, scale];
    };
  }

  function line(places, colour, width, alpha = 1) {
    pen.beginPath();
    places.forEach((p, i) => (i ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1])));
    Object.assign(pen, { strokeStyle: colour, lineWidth: width, globalAlpha: alpha });
    pen.stroke();
    pen.globalAlpha = 1;
  }
  function words(content, [x, y], colour, paper, align = "left") {
    Object.assign(pen, { textAlign: align, textBaseline: "middle", lineJoin: "round",
      lineWidth: 4, strokeStyle: paper, fillStyle: colour, font: "600 13px system-ui, sans-serif" });
    pen.strokeText(content, x, y);
    pen.fillText(content, x, y);
  }

  function drawGrid(ink, paper) {
    const step = data.grid, z = data.low[2];
    const [west, south] = [0, 1].map((i) => Math.floor(data.low[i] / step - 0.5) * step);
    const [east, north] = [0, 1].map((i) => Math.ceil(data.high[i] / step + 0.5) * step);
    const faint = mix(ink, paper, 0.86);
    for (let x = west; x < east + step / 2; x += step)
      line([project(x, south, z), project(x, north, z)], faint, 1);
    for (let y = south; y < north + step / 2; y += step)
      line([project(west, y, z), project(east, y, z)], faint, 1);
    const soft = mix(ink, paper, 0.35), clear = mix(paper, paper, 0);
    if (data.north) words("N", project((west + east) / 2, north + step / 2, z), soft, clear, "center");
    if (Math.abs(at.elevation) > 75) return;
    const [x, y] = [data.low, data.high].flatMap(([x]) => [[x, data.low[1]], [x, data.high[1]]])
      .sort((p, q) => project(...p, z)[0] - project(...q, z)[0])[0];
    const foot = project(x, y, data.tall[0]), head = project(x, y, data.tall[1]);
    line([foot, head], soft, 1.5);
    for (const [px, py] of [foot, head]) line([[px - 4, py], [px + 4, py]], soft, 1.5);
    words(data.heightText, [head[0], head[1] - 12], soft, clear, "center");
  }

  // The far side of each ring first and faint; its near side after the points that it hides.
  function drawOutlines(near) {
    const low = colours("low"), high = colours("high");
    for (const { section, xy, mean } of rings) {
      const z = data.outlines.z[section], limit = project(...mean, z)[2] + 1e-6;
      const colour = mix(low, high, data.outlines.share[section]);
      pen.beginPath();
      let last = project(xy[xy.length - 2], xy[xy.length - 1], z), drawing = false;
      for (let i = 0; i < xy.length; i += 2) {
        const next = project(xy[i], xy[i + 1], z), seen = ((last[2] + next[2]) / 2 <= limit) === near;
        if (seen && !drawing) pen.moveTo(last[0], last[1]);
        if (seen) pen.lineTo(next[0], next[1]);
        [last, drawing] = [next, seen];
      }
      Object.assign(pen, { strokeStyle: colour, lineWidth: near ? 1.7 : 1.2,
        globalAlpha: near ? 1 : farSide() });
      pen.stroke();
    }
    pen.globalAlpha = 1;
  }
  // How much of a far side shows: none of a tower seen from its foot, all of a flat heap from above.
  function farSide() {
    const steep = Math.abs(Math.tan(at.elevation * Math.PI / 180));
    return 0.22 + 0.78 * steep / (steep + hz / (Math.hypot(hx, hy) || radius) + 1e-9);
  }

  // Points go into an image of their own, where the nearest wins; those far away fade.
  function drawPoints(shown, paper, sharp) {
    const { width, height } = canvas;
    if (!image || image.width !== width || image.height !== height) {
      image = new ImageData(width, height);
      nearest = new Float32Array(width * height);
      [cloud.width, cloud.height] = [width, height];
    }
    const pixels = new Uint32Array(image.data.buffer).fill(0);
    nearest.fill(0);
    const size = Math.round(Math.min(1.7 * Math.sqrt(at.zoom), 4) * sharp);
    for (const [name, xyz] of layers) {
      if (!shown.has(name)) continue;
      const colour = colours(name), weakest = name === "points" ? 0.24 : 0.2;
      const shades = Uint32Array.from({ length: SHADES }, (_, i) => {
        const share = weakest + (name === "points" ? 0.66 : 0.56) * i / (SHADES - 1);
        return colour.reduce((sum, v, k) => sum + (Math.round(paper[k] + (v - paper[k]) * share) << 8 * k),
          255 << 24);
      });
      for (let i = 0; i < xyz.length; i += 3) {
        const [right, down, depth] = project(xyz[i], xyz[i + 1], xyz[i + 2]);
        const left = Math.round(right * sharp), top = Math.round(down * sharp), close = 10 - depth;
        if (left < 0 || top < 0 || left + size > width || top + size > height) continue;
        const shade = shades[Math.round(Math.min(Math.max((1 - depth) / 2, 0), 1) * (SHADES - 1))];
        for (let y = top; y < top + size; y++)
          for (let at = y * width + left; at < y * width + left + size; at++)
            if (close > nearest[at]) [nearest[at], pixels[at]] = [close, shade];
      }
    }
    cloud.getContext("2d").putImageData(image, 0, 0);
    pen.drawImage(cloud, 0, 0, canvas.clientWidth, canvas.clientHeight);
  }

  function drawGaps(paper) {
    const red = mix(colours("gaps"), paper, 0), halo = mix(paper, paper, 0);
    for (const [x, y, z, width, label] of [...data.gaps].reverse()) {
      const [px, py, , scale] = project(x, y, z), r = Math.max(width / 2 * scale, 5);
      for (const [colour, thick] of [[halo, 5], [red, 2]]) {
        line([[px - 4, py - 4], [px + 4, py + 4]], colour, thick);
        line([[px - 4, py + 4], [px + 4, py - 4]], colour, thick);
        pen.beginPath();
        pen.arc(px, py, r, 0, 2 * Math.PI);
        pen.stroke();
      }
      words(label, [px + r + 6, py], red, halo);
    }
  }

  function draw() {
    const sharp = Math.min(devicePixelRatio || 1, 2);
    const wide = canvas.clientWidth, high = canvas.clientHeight;
    if (!wide || !high) return;
    if (canvas.width !== Math.round(wide * sharp) || canvas.height !== Math.round(high * sharp)) {
      canvas.width = Math.round(wide * sharp);
      canvas.height = Math.round(high * sharp);
    }
    const paper = colours("paper"), ink = parse(getComputedStyle(view).getPropertyValue("--ink").trim());
    const shown = new Set(boxes.filter((box) => box.checked).map((box) => box.dataset.layer));
    pen.setTransform(sharp, 0, 0, sharp, 0, 0);
    pen.clearRect(0, 0, wide, high);
    aim(wide, high);
    drawGrid(ink, paper);
    if (shown.has("outlines")) drawOutlines(false);
    drawPoints(shown, paper, sharp);
    if (shown.has("outlines")) drawOutlines(true);
    if (shown.has("gaps")) drawGaps(paper);
  }

  function turn(right, up) {
    at.azimuth = (at.azimuth + right) % 360;
    at.elevation = Math.min(Math.max(at.elevation + up, -90), 90);
    redraw();
  }
  // What lies under (x, y), from the canvas's middle, stays there.
  function zoom(factor, x = 0, y = 0) {
    const now = Math.min(Math.max(at.zoom * factor, 0.4), 40), ratio = now / at.zoom;
    Object.assign(at, { zoom: now, x: x - (x - at.x) * ratio, y: y - (y - at.y) * ratio });
    redraw();
    return ratio !== 1;
  }
  const reset = () => { Object.assign(at, FIRST); redraw(); };
  const fromMiddle = (x, y) => {
    const box = canvas.getBoundingClientRect();
    return [x - box.left - box.width / 2, y - box.top - box.height / 2];
  };

  const fingers = new Map();
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, event);
  });
  for (const end of ["pointerup", "pointercancel"])
    canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const right = event.clientX - before.clientX, down = event.clientY - before.clientY;
    const other = [...fingers.values()].find((finger) => finger.pointerId !== event.pointerId);
    fingers.set(event.pointerId, event);
    if (other) {
      const apart = (finger) => Math.hypot(finger.clientX - other.clientX, finger.clientY - other.clientY);
      zoom(apart(event) / (apart(before) || 1), ...fromMiddle(other.clientX, other.clientY));
    } else if (event.shiftKey) {
      at.x += right;
      at.y += down;
      redraw();
    } else turn(right * 0.45, down * 0.45);
  });
  // At the ends of the zoom the wheel is the page's again.
  canvas.addEventListener("wheel", (event) => {
    const lines = event.deltaY * (event.deltaMode ? 30 : 1);
    if (zoom(Math.exp(-lines * 0.0015), ...fromMiddle(event.clientX, event.clientY)))
      event.preventDefault();
  }, { passive: false });
  canvas.addEventListener("dblclick", reset);
  const keys = { ArrowLeft: () => turn(-5, 0), ArrowRight: () => turn(5, 0), ArrowUp: () => turn(0, -5),
    ArrowDown: () => turn(0, 5), "+": () => zoom(1.2), "=": () => zoom(1.2), "-": () => zoom(1 / 1.2),
    "0": reset, Home: reset };
  canvas.addEventListener("keydown", (event) => {
    if (!keys[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
    keys[event.key]();
    event.preventDefault();
  });
  for (const button of view.querySelectorAll("button"))
    button.addEventListener("click", () => {
      reset();
      if (!button.dataset.turn) return;
      [at.azimuth, at.elevation] = button.dataset.turn.split(",").map(Number);
    });
  boxes.forEach((box) => box.addEventListener("change", redraw));

  view.hidden = false;
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", readColours);
  new ResizeObserver(redraw).observe(canvas);
  readColours();
}

document.querySelectorAll(".view").forEach(start);
