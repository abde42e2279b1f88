// @ts-check
// Where each camera has seen the light: its picture in cells, which fill as it comes there.
import { make, number, plural, write } from "./dom.js";
import { percent } from "./calibrating.js";

/** @typedef {import("./calibrating.js").Calibrating} Calibrating */
/** @typedef {import("./calibrating.js").Progress} Progress */

const GAP_PX = 1.5;
const SHAPE = 4 / 3;

/** The colour of a part of what is enough: a name of a custom property. @param {number} part */
export const levelOf = (part) => (part <= 0 ? "--none" : part < 1 ? "--some" : "--full");

/** @param {import("./main.js").Context} context */
export function cameraMaps(context) {
  /** @type {ReturnType<typeof map>[]} */
  let maps = [];
  const element = make("div", { class: "maps" });
  const key = (/** @type {string} */ css, /** @type {string} */ words) => make("span", {}, make("i", { class: `cell ${css}` }), words);
  const legend = make("p", { class: "dim maps-legend" }, key("none", "never there"), key("some", "some"), key("full", "often enough"));
  const sized = new ResizeObserver(() => again());
  const again = () => {
    for (const it of maps) it.resize();
  };

  /** @param {string} name */
  function map(name) {
    const size = context.hello.cameras.find((it) => it.name === name)?.size;
    const shape = size ? size[0] / size[1] : SHAPE;
    const canvas = make("canvas", { role: "img", style: `aspect-ratio: ${shape}` });
    const pen = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    const done = make("span", { class: "good", hidden: true }, "✓ done");
    const frames = make("span");
    const bar = make("progress", { "aria-label": `Frames of ${name}` });
    const facts = make("span", { class: "dim" });
    const element = make("div", { class: "map", "data-camera": name }, canvas, make("div", { class: "map-head" }, make("b", {}, name), done), bar, frames, facts);
    /** @type {Progress|null} */
    let progress = null;
    /** @type {Calibrating|null} */
    let now = null;
    let drawn = "";

    function paint() {
      if (!progress || !now) return;
      const { columns, rows, full_cell } = now;
      const [w, h] = [canvas.width / columns, canvas.height / rows];
      const gap = GAP_PX * devicePixelRatio;
      pen.clearRect(0, 0, canvas.width, canvas.height);
      progress.cells.forEach((count, index) => {
        const [x, y] = [(index % columns) * w, Math.floor(index / columns) * h];
        const part = Math.min(1, count / Math.max(1, full_cell));
        pen.fillStyle = context.css(levelOf(part));
        pen.globalAlpha = 0.28;
        pen.fillRect(x, y, w - gap, h - gap);
        pen.globalAlpha = 1;
        // The height says how much, for who sees no colours.
        pen.fillRect(x, y + (h - gap) * (1 - part), w - gap, (h - gap) * part);
        if (part > 0) return;
        pen.fillRect(x + w / 2 - 2 * gap, y + h / 2 - gap, 3 * gap, gap);
      });
    }

    return {
      name,
      element,
      canvas,
      /** @param {Calibrating} value @param {Progress} own */
      show(value, own) {
        now = value;
        progress = own;
        const { full_cell, min_frames, min_share } = value;
        const full = own.cells.filter((count) => count >= full_cell).length;
        const empty = own.cells.filter((count) => count <= 0).length;
        done.hidden = !own.done;
        element.classList.toggle("done", own.done);
        bar.max = min_frames;
        bar.value = Math.min(own.frames, min_frames);
        write(frames, `${plural(own.frames, "frame")} (${min_frames} needed)`);
        const depth = own.depth_m ? `, ${number(own.depth_m[0])}–${number(own.depth_m[1])} m away` : "";
        write(facts, `${percent(own.share)} of its picture (${percent(min_share)} needed), ${plural(own.partners, "partner")}${depth}`);
        canvas.setAttribute("aria-label", `Picture of ${name}: ${full} of ${own.cells.length} cells often enough, ${empty} empty`);
      },
      resize() {
        const w = Math.max(1, Math.round(canvas.clientWidth * devicePixelRatio));
        canvas.width = w;
        canvas.height = Math.max(1, Math.round(w / shape));
        drawn = "";
      },
      draw() {
        const wanted = progress ? `${progress.cells.join()} ${now?.full_cell} ${context.theme()}` : "";
        if (wanted === drawn) return;
        drawn = wanted;
        paint();
      },
    };
  }

  return {
    element,
    legend,
    /** @param {Calibrating} now */
    show(now) {
      if (now.cameras.length !== maps.length || now.cameras.some((it, index) => it.name !== maps[index].name)) {
        sized.disconnect();
        maps = now.cameras.map((it) => map(it.name));
        element.replaceChildren(...maps.map((it) => it.element));
        for (const it of maps) sized.observe(it.canvas);
      }
      maps.forEach((it, index) => it.show(now, now.cameras[index]));
    },
    draw() {
      for (const it of maps) it.draw();
    },
    /** While it is shown. @param {boolean} isShown */
    listen(isShown) {
      sized.disconnect();
      if (isShown) for (const it of maps) sized.observe(it.canvas);
    },
  };
}
