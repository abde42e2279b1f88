// @ts-check
// One camera in the grid: its picture with what was found in it, and a caption with what its edges measure.
import { make, ms, number, plural, write } from "./dom.js";
import { masksOf, traffic } from "./lookup.js";
import { Matched } from "./matched.js";
import { drawFeatures, drawMasks, SILHOUETTE } from "./overlay.js";
import { GRAY, Picture } from "./picture.js";

/** @typedef {import("./main.js").Frame} Frame */

/** A camera that sends nothing for so long gets a sign. */
export const STALE_MS = 2000;
const MARKS_FOR_PX = 320;

/** How long nothing has come, while something should: time in which the run stands does not count. */
export function silence() {
  let came = false;
  let waited = 0;
  let before = 0;
  return {
    came() {
      came = true;
      waited = 0;
    },
    /** From here on nothing is expected: what was hidden was not subscribed. */
    rest() {
      before = 0;
      waited = 0;
    },
    /** The sign, or "". @param {number} now @param {boolean} isRunning */
    words(now, isRunning) {
      if (isRunning && before) waited += now - before;
      before = isRunning ? now : 0;
      if (!came) return isRunning && waited < STALE_MS ? "" : "no pictures yet";
      return waited < STALE_MS ? "" : `no pictures for ${Math.floor(waited / 1000)} s`;
    },
  };
}

/**
 * @param {import("./main.js").Context} context
 * @param {import("./lookup.js").Served} camera
 */
export function tile(context, camera) {
  const canvas = make("canvas", { "aria-hidden": "true" });
  const pen = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d", { alpha: false }));
  const sign = make("span", { class: "sign" });
  const rate = make("span", { class: "rate" });
  const facts = make("span", { class: "facts" });
  const gaps = make("span");
  const drops = make("span");
  const age = make("span");
  const found = make("span", { class: "found" });
  facts.append(age, gaps, drops);
  const element = make(
    "div",
    { class: "tile", role: "option", tabindex: -1, "aria-selected": "false", "data-camera": camera.name },
    make("div", { class: "frame", style: `aspect-ratio: ${camera.size[0]} / ${camera.size[1]}` }, canvas, sign),
    make("div", { class: "caption" }, make("b", {}, camera.name), found, rate, facts),
  );
  const picture = new Picture();
  const shade = new Picture();
  const quiet = silence();
  const outline = new Matched();
  /** @type {Map<number, Matched>} */
  const features = new Map(camera.features.map((topic) => [topic, new Matched()]));
  let dirty = true;

  /** Drawn again only when what belongs to the picture changes. */
  function match() {
    const time_s = picture.frame?.time_s;
    for (const found of features.values()) if (found.match(time_s)) dirty = true;
    if (outline.match(time_s) && outline.shown) {
      shade.take(outline.shown);
      dirty = true;
    }
  }

  const lists = () => [...features.values()].map((found) => found.shown?.header.list ?? []);

  function paint() {
    const image = picture.paint(GRAY);
    const [width, height] = camera.size;
    const scale = canvas.width / width;
    const onto = (/** @type {number} */ u, /** @type {number} */ v) => /** @type {[number, number]} */ ([(u + 0.5) * scale, (v + 0.5) * scale]);
    pen.fillStyle = context.css("--void");
    pen.fillRect(0, 0, canvas.width, canvas.height);
    for (const layer of [image && picture, shade.paint(SILHOUETTE) && shade]) {
      if (!layer) continue;
      const [left, top, w, h] = layer.place();
      const [x, y] = onto(left, top);
      pen.imageSmoothingEnabled = layer.pixel() * scale <= 2;
      pen.drawImage(layer.canvas, x, y, w * scale, h * scale);
    }
    // On large tiles the marks grow too, less than the tile.
    const unit = devicePixelRatio * Math.min(Math.max(canvas.clientWidth / MARKS_FOR_PX, 1), 2);
    drawMasks(pen, onto, masksOf(context.hello, camera), context.css("--mask"), unit);
    const colours = { cross: context.css("--cross"), circle: context.css("--circle") };
    for (const list of lists()) drawFeatures(pen, onto, list, colours, unit, false);
  }

  return {
    element,
    last: picture,
    /** @param {Frame} frame */
    picture(frame) {
      picture.take(frame);
      quiet.came();
      match();
      dirty = true;
    },
    /** @param {Frame} frame */
    silhouette(frame) {
      outline.take(frame);
      match();
    },
    /** @param {Frame} frame */
    features(frame) {
      features.get(frame.topic)?.take(frame);
      match();
    },
    /** @param {import("./main.js").State} state */
    state(state) {
      const measured = traffic(state, camera);
      write(rate, `${number(measured.rate)}/s`);
      write(age, measured.age === null ? "" : `${ms(measured.age)} ms`);
      write(gaps, measured.gaps === null ? "" : plural(measured.gaps, "gap"));
      write(drops, measured.drops === null ? "" : plural(measured.drops, "drop"));
      gaps.classList.toggle("bad", Boolean(measured.gaps));
      drops.classList.toggle("bad", Boolean(measured.drops));
      // The edges of a recording do not count what was found: the frames do.
      const come = [...features.values()].flatMap((it) => it.best ?? []);
      write(found, come.length ? plural(come.reduce((sum, frame) => sum + (frame.header.list?.length ?? 0), 0), "feature") : "");
      const words = quiet.words(performance.now(), state.phase === "running");
      write(sign, words);
      sign.hidden = words === "";
      element.classList.toggle("stale", words !== "");
      element.setAttribute("aria-label", `${camera.name}: ${words || `${rate.textContent}, ${[age, gaps, drops, found].map((it) => it.textContent).filter(Boolean).join(", ")}`}`);
    },
    /** @param {boolean} isChosen */
    choose(isChosen) {
      element.setAttribute("aria-selected", String(isChosen));
      element.tabIndex = isChosen ? 0 : -1;
    },
    /** @param {number} width in CSS pixels */
    resize(width) {
      const w = Math.round(width * devicePixelRatio);
      const h = Math.round((w * camera.size[1]) / camera.size[0]);
      if (canvas.width !== w || canvas.height !== h) {
        canvas.width = w;
        canvas.height = h;
      }
      dirty = true;
    },
    changed() {
      dirty = true;
    },
    show() {
      quiet.rest();
      dirty = true;
    },
    /** @param {number} _now */
    draw(_now) {
      if (!dirty) return;
      dirty = false;
      paint();
    },
  };
}
