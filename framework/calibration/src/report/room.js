"use strict";
(() => {
  const holder = document.getElementById("room-data");
  const canvas = document.getElementById("room-canvas");
  const pen = canvas && canvas.getContext("2d");
  if (!holder || !pen) return;
  document.documentElement.classList.add("scripted");
  const room = JSON.parse(holder.textContent);
  const colour = document.getElementById("room-colour");
  const names = document.getElementById("room-names");
  const sigma = document.getElementById("room-sigma");
  const key = document.getElementById("room-key");
  if (room.cameras.length > 40) names.checked = false;
  const middle = room.low.map((it, axis) => (it + room.high[axis]) / 2);
  const size = Math.hypot(...room.low.map((it, axis) => room.high[axis] - it)) || 1;
  let view, hovered = null;
  const reset = () => { view = { turn: room.view[0], tilt: room.view[1], zoom: 1, shift: [0, 0] }; };
  reset();

  // From dark blue over green to yellow: even in lightness, and safe for colour-blind readers.
  const ramp = [[68, 1, 84], [59, 82, 139], [33, 145, 140], [94, 201, 98], [253, 231, 37]];
  const shade = (part) => {
    const at = Math.min(Math.max(part, 0), 0.9999) * (ramp.length - 1), low = Math.floor(at), mix = at - low;
    return `rgb(${ramp[low].map((it, index) => Math.round(it + (ramp[low + 1][index] - it) * mix)).join(",")})`;
  };
  const range = (list) => {
    const known = list.filter((it) => it !== null).sort((a, b) => a - b);
    return known.length ? [known[0], known[Math.floor(0.98 * (known.length - 1))]] : [0, 1];
  };
  const ranges = { t: range(room.t), r: range(room.r) };

  let scale, width, height, cos, sin;
  const seen = (x, y, z) => {
    x -= middle[0]; y -= middle[1]; z -= middle[2];
    const across = x * cos[0] - y * sin[0], away = x * sin[0] + y * cos[0];
    return [
      width / 2 + view.shift[0] + scale * across,
      height / 2 + view.shift[1] - scale * (away * sin[1] + z * cos[1]),
      away * cos[1] - z * sin[1],
    ];
  };
  const at = (list, index) => seen(list[3 * index], list[3 * index + 1], list[3 * index + 2]);
  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  const draw = () => {
    const dense = window.devicePixelRatio || 1;
    width = canvas.clientWidth; height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * dense) || canvas.height !== Math.round(height * dense)) {
      canvas.width = Math.round(width * dense); canvas.height = Math.round(height * dense);
    }
    pen.setTransform(dense, 0, 0, dense, 0, 0);
    pen.clearRect(0, 0, width, height);
    scale = view.zoom * 0.85 * Math.min(width, 1.4 * height) / size;
    cos = [Math.cos(view.turn), Math.cos(view.tilt)]; sin = [Math.sin(view.turn), Math.sin(view.tilt)];
    const [ink, muted, line, accent, warm] = ["--ink", "--muted", "--line", "--s0", "--s1"].map(style);

    pen.lineWidth = 1; pen.strokeStyle = line; pen.beginPath();
    for (let index = 0; index < room.grid.length / 3; index += 2) {
      const [a, b] = [at(room.grid, index), at(room.grid, index + 1)];
      pen.moveTo(a[0], a[1]); pen.lineTo(b[0], b[1]);
    }
    pen.stroke();
    if (room.placed) {
      const origin = seen(0, 0, 0);
      [["x", "#d64545"], ["y", "#2f9e44"], ["z", "#3b7ddd"]].forEach(([name, paint], axis) => {
        const end = seen(...[0, 1, 2].map((it) => (it === axis ? room.step : 0)));
        pen.strokeStyle = pen.fillStyle = paint; pen.lineWidth = 2.5;
        pen.beginPath(); pen.moveTo(origin[0], origin[1]); pen.lineTo(end[0], end[1]); pen.stroke();
        pen.font = "600 12px system-ui, sans-serif"; pen.fillText(name, end[0] + 4, end[1] - 3);
      });
    }

    const by = colour.value, [low, high] = ranges[by], list = room[by];
    let before = null;
    pen.lineWidth = 1.6;
    for (let index = 0; index < room.t.length; index++) {
      const here = at(room.path, index);
      pen.strokeStyle = pen.fillStyle = list[index] === null ? muted : shade((list[index] - low) / (high - low || 1));
      if (room.joined[index] && before) {
        pen.beginPath(); pen.moveTo(before[0], before[1]); pen.lineTo(here[0], here[1]); pen.stroke();
      } else {
        pen.fillRect(here[0] - 1.2, here[1] - 1.2, 2.4, 2.4);
      }
      before = here;
    }

    const order = room.cameras.map((camera) => [seen(...camera.c), camera]).sort((a, b) => b[0][2] - a[0][2]);
    for (const [centre, camera] of order) {
      if (sigma.checked && camera.e) {
        pen.strokeStyle = warm; pen.fillStyle = warm; pen.lineWidth = 1;
        // The outline of an ellipsoid, seen from afar, is the ellipse of its half axes' pictures.
        let [xx, xy, yy] = [0, 0, 0];
        for (let axis = 0; axis < 3; axis++) {
          const end = seen(...[0, 1, 2].map((it) => camera.c[it] + camera.e[3 * axis + it]));
          const [dx, dy] = [end[0] - centre[0], end[1] - centre[1]];
          xx += dx * dx; xy += dx * dy; yy += dy * dy;
        }
        const mean = (xx + yy) / 2, off = Math.hypot((xx - yy) / 2, xy);
        const axes = [Math.sqrt(mean + off), Math.sqrt(Math.max(mean - off, 0))];
        pen.beginPath();
        pen.ellipse(centre[0], centre[1], axes[0], axes[1], Math.atan2(2 * xy, xx - yy) / 2, 0, 2 * Math.PI);
        pen.globalAlpha = 0.18; pen.fill(); pen.globalAlpha = 1; pen.stroke();
      }
      const corners = [0, 1, 2, 3].map((it) => at(camera.f, it));
      const chosen = hovered === camera;
      pen.strokeStyle = accent; pen.lineWidth = chosen ? 2.4 : 1.3; pen.beginPath();
      corners.forEach((corner, index) => {
        const next = corners[(index + 1) % 4];
        pen.moveTo(centre[0], centre[1]); pen.lineTo(corner[0], corner[1]); pen.lineTo(next[0], next[1]);
      });
      pen.stroke();
      pen.fillStyle = accent; pen.globalAlpha = 0.12; pen.beginPath();
      corners.forEach((corner) => pen.lineTo(corner[0], corner[1]));
      pen.fill(); pen.globalAlpha = 1;
    }
    pen.font = "12px system-ui, sans-serif"; pen.fillStyle = ink; pen.lineWidth = 3; pen.strokeStyle = style("--card");
    for (const [centre, camera] of order) {
      if (names.checked || hovered === camera) {
        pen.strokeText(camera.n, centre[0] + 6, centre[1] - 6); pen.fillText(camera.n, centre[0] + 6, centre[1] - 6);
      }
    }
    pen.fillStyle = muted;
    pen.fillText(`a cell of the grid is ${+room.step.toPrecision(3)} ${room.unit}`, 10, height - 10);
    const ends = [low, high].map((it) => it.toFixed(by === "t" ? 1 : 2)), unit = by === "t" ? "s" : "px";
    key.innerHTML = `<span class="ramp" style="background:linear-gradient(90deg,${[0, 0.25, 0.5, 0.75, 0.9999].map(shade).join()})"></span>`;
    key.prepend(`${ends[0]} ${unit} `); key.append(` ${ends[1]} ${unit}${by === "r" ? " and more" : ""}`);
  };

  let asked = false;
  const ask = () => {
    if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; draw(); }); }
  };
  let held = null;
  canvas.addEventListener("pointerdown", (event) => {
    held = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (held) {
      const [dx, dy] = [event.clientX - held[0], event.clientY - held[1]];
      held = [event.clientX, event.clientY];
      if (event.shiftKey || event.buttons === 4) {
        view.shift = [view.shift[0] + dx, view.shift[1] + dy];
      } else {
        view.turn += 0.008 * dx;
        view.tilt = Math.min(Math.max(view.tilt + 0.008 * dy, -Math.PI / 2), Math.PI / 2);
      }
      ask();
      return;
    }
    const box = canvas.getBoundingClientRect();
    let nearest = 14, found = null;
    for (const camera of room.cameras) {
      const centre = seen(...camera.c);
      const away = Math.hypot(centre[0] - event.clientX + box.left, centre[1] - event.clientY + box.top);
      if (away < nearest) { nearest = away; found = camera; }
    }
    if (found !== hovered) { hovered = found; ask(); }
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { held = null; });
  const zoom = (factor) => { view.zoom = Math.min(Math.max(view.zoom * factor, 0.2), 50); ask(); };
  canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(-0.0015 * event.deltaY)); }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    if (turns) {
      view.turn += turns[0]; view.tilt = Math.min(Math.max(view.tilt + turns[1], -Math.PI / 2), Math.PI / 2); ask();
    } else if (event.key === "+" || event.key === "=") zoom(1.2);
    else if (event.key === "-") zoom(1 / 1.2);
    else return;
    event.preventDefault();
  });
  for (const control of [colour, names, sigma]) control.addEventListener("change", ask);
  const again = () => { reset(); ask(); };
  document.getElementById("room-reset").addEventListener("click", again);
  canvas.addEventListener("dblclick", again);
  addEventListener("resize", ask);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", ask);
  draw();
})();
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((it) => { it.open = true; }));
