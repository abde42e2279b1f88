// @ts-check
// One camera, large: down to its pixels, with its detector's thresholds, false features and masks.
import { clock, make, number, plural, write } from "./dom.js";
import { ARROWS, cameraStage, tool } from "./camera_stage.js";
import { heatMap } from "./heat.js";
import { masksOf, setting, traffic } from "./lookup.js";
import { maskPainter } from "./masks.js";
import { Matched } from "./matched.js";
import { drawFeatures, drawMasks, SILHOUETTE } from "./overlay.js";
import { GRAY, palette, Picture } from "./picture.js";
import { saveBar, settingsEditor } from "./settings.js";
import { silence } from "./camera_tile.js";

/** @typedef {import("./main.js").Frame} Frame */

const PICTURE_HZ = 20;
const SILHOUETTE_HZ = 30;
/** As often as they come, so that those of each picture are there. */
const FEATURE_HZ = 60;
const NEAR_PX = 8;

/**
 * @param {import("./main.js").Context} context
 * @param {import("./lookup.js").Served} camera
 * @param {{back: () => void, by: (step: number) => void, picture: Picture}} grid
 */
export function largeCamera(context, camera, grid) {
  const { hello } = context;
  const [width, height] = camera.size;
  const on = { features: true, masks: true, silhouettes: true, threshold: false, heat: false, paint: false };
  const picture = new Picture();
  const shade = new Picture();
  if (grid.picture.frame) picture.take(grid.picture.frame);
  const outline = new Matched();
  const features = new Map(camera.features.map((topic) => [topic, new Matched()]));
  const quiet = silence();
  const heat = heatMap(camera.size);
  let heatFrom = 0;
  let newest = 0;
  let dirty = true;
  /** @type {[number, number]|null} */
  let pointer = null;

  const maskNode = camera.detectors.find((node) => setting(hello, node, "masks")) ?? null;
  const ofAll = maskNode === null ? null : setting(hello, maskNode, "masks");
  const ofCameras = maskNode === null ? null : setting(hello, maskNode, "camera_masks");
  /** Masks of this camera alone where the node has such; otherwise those of all its cameras. */
  const maskSetting = ofCameras ?? ofAll;
  const own = () => (ofCameras ? ofCameras.value?.[camera.name] : ofAll?.value) ?? [];
  const canPaint = Boolean(maskSetting?.live) && hello.rig.can.set;
  const painter = maskPainter(
    own,
    async (masks) => {
      const values = ofCameras ? { camera_masks: { ...ofCameras.value, [camera.name]: masks } } : { masks };
      const answer = await context.command({ do: "set", node: maskNode, values });
      if (!answer.ok) context.say(`The masks are as they were: ${answer.words}`);
      tell();
    },
  );

  /** The chosen mask among all that are drawn. */
  const chosenMask = () => (painter.chosen === null ? null : painter.chosen + masksOf(hello, camera).length - own().length);

  const stage = cameraStage(context, camera, {
    changed: touch,
    over(u, v) {
      pointer = [u, v];
      touch();
    },
    out() {
      if (!on.paint) pointer = null;
      touch();
    },
    click(u, v, _event, isSecond) {
      pointer = [u, v];
      if (!on.paint || !canPaint) return touch();
      painter.click(u, v, NEAR_PX / zoom.scale, isSecond);
      tell();
    },
  });
  const { canvas, pen, zoom } = stage;

  function touch() {
    dirty = true;
  }

  const lists = () => [...features.values()].map((found) => found.shown?.header.list ?? []);

  // The bar above the picture.
  const title = make("b");
  const facts = make("span", { class: "dim" });
  const reading = make("output", { class: "reading", "aria-label": "Pixel" });
  /** @type {[keyof typeof on, string, string, string, boolean][]} */
  const switches = [
    ["features", "Features", "f", "Features that were found", camera.features.length > 0],
    ["masks", "Masks", "m", "Regions that are not searched", maskSetting !== null],
    ["silhouettes", "Silhouettes", "s", "Silhouettes", camera.silhouette !== null],
    ["threshold", "Threshold", "t", "What is brighter than the detector's threshold", levels() !== null],
    ["heat", "False features", "h", "Where features are found over time", camera.features.length > 0],
    ["paint", "Paint masks", "p", "Paint regions that are not to be searched", maskSetting !== null],
  ];
  /** @type {Map<string, HTMLElement>} */
  const buttons = new Map();
  for (const [name, words, key, says, has] of switches) if (has) buttons.set(name, tool(words, key, () => flip(name), says));
  const bar = make(
    "div",
    { class: "camera-bar", role: "toolbar", "aria-label": "Camera" },
    tool("All", "Esc", grid.back, "All cameras"),
    title,
    facts,
    make("span", { class: "tools" }, ...buttons.values()),
    stage.tools,
    reading,
  );
  write(title, camera.name);

  // What a way of looking means, below the bar.
  const clear = make("button", { type: "button", class: "tool", onclick: clearHeat }, "Clear", make("kbd", {}, "c"));
  const note = make("span");
  const notes = make("p", { class: "camera-note", hidden: true }, note, clear);
  const sign = make("p", { class: "camera-sign bad", hidden: true });

  const save = saveBar(context);
  const nodes = [...camera.detectors, ...(camera.source === null ? [] : [camera.source])];
  const editors = nodes.map((node) => settingsEditor(context, node));
  const panel = make("aside", { class: "panel", "aria-label": "Settings" }, save.element, ...editors.map((it) => it.element));
  if (!nodes.length) panel.append(make("p", { class: "dim" }, "No node of this camera has settings."));
  stage.element.append(sign);
  const element = make("div", { class: "large" }, bar, notes, make("div", { class: "large-row" }, stage.element, panel));

  /** The levels of the first detector that has any: the threshold, and what a feature's brightest pixel must reach. */
  function levels() {
    for (const node of camera.detectors) {
      const low = setting(hello, node, "min_threshold") ?? setting(hello, node, "threshold");
      const high = setting(hello, node, "min_peak");
      const [first, second] = low ? [low, high] : [high, null];
      if (typeof first?.value === "number") return { node, low: first, high: typeof second?.value === "number" ? second : null };
    }
    return null;
  }

  let colours = GRAY;
  let coloursOf = "";
  /** Gray, or what is above the levels in colour and the rest dim. */
  function paletteNow() {
    const level = on.threshold ? levels() : null;
    const key = level ? `${level.low.value} ${level.high?.value}` : "";
    if (key === coloursOf) return colours;
    coloursOf = key;
    const peak = level?.high?.value ?? 256;
    colours = level
      ? palette((gray) => (gray >= Math.max(peak, level.low.value) ? [240, 228, 66, 255] : gray >= level.low.value ? [230, 159, 0, 255] : [0.45 * gray, 0.45 * gray, 0.5 * gray, 255]))
      : GRAY;
    return colours;
  }

  function clearHeat() {
    heat.clear();
    heatFrom = newest;
    tell();
  }

  /** The note, for the way of looking that was chosen last. */
  function tell() {
    touch();
    const words = [];
    const level = levels();
    if (on.threshold && level) {
      const { name } = hello.nodes[level.node];
      words.push(`Orange: at least ${name}.${level.low.name} = ${level.low.value}${level.high ? `; yellow: at least ${level.high.name} = ${level.high.value}` : ""}.`);
      if (setting(hello, level.node, "offset")) words.push("Where a background was learnt, it and the offset are the threshold.");
    }
    if (on.heat) {
      const { count, u, v } = heat.hottest();
      words.push(`${plural(heat.n, "feature")} in ${plural(heat.pictures, "picture")}, ${clock(Math.max(0, newest - heatFrom))}${count > 1 ? `; most, ${count}, at u ${number(u, 0)}, v ${number(v, 0)}` : ""}.`);
    }
    if (on.paint && maskNode !== null) {
      const { name, instances } = hello.nodes[maskNode];
      if (!hello.rig.can.set) words.push("A recording keeps its settings.");
      else if (!canPaint) words.push(`${name}.${maskSetting?.name} cannot be changed while the rig runs.`);
      else words.push(painter.words());
      if (instances.length > 1 && !ofCameras) words.push("Masks apply to every camera of this node.");
    }
    write(note, words.join(" "));
    notes.hidden = words.length === 0;
    clear.hidden = !on.heat;
  }

  /** @param {keyof typeof on} name */
  function flip(name) {
    if (!buttons.has(name)) return;
    on[name] = !on[name];
    if (name === "heat") clearHeat();
    // A tint would hide what is above the threshold.
    if (name === "threshold" && on.threshold) on.silhouettes = false;
    if (name === "paint") {
      painter.giveUp();
      if (on.paint) on.masks = true;
      canvas.classList.toggle("painting", on.paint && canPaint);
    }
    pressed();
    tell();
  }

  function pressed() {
    for (const [name, button] of buttons) button.setAttribute("aria-pressed", String(on[/** @type {keyof typeof on} */ (name)]));
  }

  function read() {
    const value = pointer && picture.at(...pointer);
    const [u, v] = pointer ?? [0, 0];
    write(reading, value ? `u ${number(u, 1)}  v ${number(v, 1)}  ${value.length === 1 ? `gray ${value[0]}` : `rgb ${value.join(" ")}`}` : "");
    stage.tell();
  }

  function paint() {
    const unit = stage.unit();
    stage.clear();
    if (picture.paint(paletteNow())) stage.lay(picture.canvas, picture.place(), picture.pixel());
    if (on.silhouettes && shade.paint(SILHOUETTE)) stage.lay(shade.canvas, shade.place(), shade.pixel());
    if (on.heat) stage.lay(heat.paint(), [-0.5, -0.5, heat.canvas.width * heat.cell, heat.canvas.height * heat.cell], Infinity);
    stage.border();
    const mask = context.css("--mask");
    if (on.masks) drawMasks(pen, zoom.onto, masksOf(hello, camera), mask, unit, on.paint ? chosenMask() : null);
    if (on.features) for (const list of lists()) drawFeatures(pen, zoom.onto, list, { cross: context.css("--cross"), circle: context.css("--circle") }, unit, true);
    if (!on.paint) return;
    painter.draw(pen, zoom.onto, pointer, mask, unit);
    if (pointer && document.activeElement === canvas) {
      const [x, y] = zoom.onto(...pointer);
      pen.strokeStyle = mask;
      pen.lineWidth = unit;
      pen.strokeRect(x - 5 * unit, y - 5 * unit, 10 * unit, 10 * unit);
    }
  }

  /** Painting by keys: arrows move the pointer, the space bar sets a corner. @param {KeyboardEvent} event */
  function paintKey(event) {
    const step = event.shiftKey ? 1 : 10;
    const by = ARROWS[event.key];
    if (by) {
      const [u, v] = pointer ?? [width / 2, height / 2];
      pointer = [Math.min(Math.max(Math.round(u) + by[0] * step, 0), width - 1), Math.min(Math.max(Math.round(v) + by[1] * step, 0), height - 1)];
      zoom.reach(...pointer);
    } else if (event.key === " " && pointer && canPaint) painter.click(...pointer, 0, false);
    else if (event.key === "Enter" && painter.isOpen) painter.close();
    else if (event.key === "Backspace" && painter.isOpen) painter.removeCorner();
    else if (event.key === "Escape") {
      if (!painter.giveUp()) flip("paint");
    } else if (event.key === "Delete" && canPaint) painter.removeChosen();
    else if (event.key === "n") painter.chooseNext(1);
    else return false;
    tell();
    return true;
  }

  /** @type {Record<string, () => void>} */
  const keys = {
    ...stage.keys,
    Escape: grid.back,
    c: () => on.heat && clearHeat(),
    PageDown: () => grid.by(1),
    PageUp: () => grid.by(-1),
  };
  for (const [name, , key] of switches) keys[key] = () => flip(name);

  return {
    element,
    resize: stage.resize,
    wants() {
      return [
        ...(camera.image === null ? [] : [{ topic: camera.image, as: /** @type {const} */ ("picture"), width: 0, hz: PICTURE_HZ }]),
        ...(camera.silhouette === null ? [] : [{ topic: camera.silhouette, as: /** @type {const} */ ("picture"), width: 0, hz: SILHOUETTE_HZ }]),
        ...camera.features.map((topic) => ({ topic, as: /** @type {const} */ ("value"), hz: FEATURE_HZ })),
      ];
    },
    /** @param {Frame} frame */
    frame(frame) {
      if (frame.topic === camera.image) {
        picture.take(frame);
        newest = frame.time_s;
        quiet.came();
      } else if (frame.topic === camera.silhouette) outline.take(frame);
      else if (features.has(frame.topic)) {
        features.get(frame.topic)?.take(frame);
        if (on.heat) heat.add(frame.header.list ?? []);
        // Of several detectors, each sends its features of the same picture.
        if (on.heat && frame.topic === camera.features[0]) heat.pictures++;
      }
      const time_s = picture.frame?.time_s;
      for (const found of features.values()) found.match(time_s);
      if (outline.match(time_s) && outline.shown) shade.take(outline.shown);
      touch();
    },
    /** @param {import("./main.js").State} state */
    state(state) {
      const { rate, gaps, drops, age } = traffic(state, camera);
      const come = [...features.values()].flatMap((it) => it.best ?? []);
      const n = come.reduce((sum, frame) => sum + (frame.header.list?.length ?? 0), 0);
      write(facts, `${width} × ${height} px · ${number(rate)}/s · ${[age === null ? "" : `${number(age)} ms`, gaps === null ? "" : plural(gaps, "gap"), drops === null ? "" : plural(drops, "drop"), come.length ? plural(n, "feature") : ""].filter(Boolean).join(" · ")}`);
      const words = quiet.words(performance.now(), state.phase === "running");
      write(sign, words);
      sign.hidden = words === "";
      save.state(state);
      if (on.heat) tell();
    },
    /** @param {number} node @param {Record<string, any>} values */
    settings(node, values) {
      for (const editor of editors) editor.settings(node, values);
      tell();
    },
    draw(/** @type {number} */ _now) {
      if (!dirty) return;
      dirty = false;
      paint();
      read();
    },
    show() {
      quiet.rest();
      pressed();
      stage.show();
    },
    hide: stage.hide,
    /** @returns {[string, string][]} */
    get help() {
      return [
        ["Esc", "all cameras"],
        ["PageUp PageDown", "the camera before, after"],
        ["+ − wheel", "zoom"],
        ["0", "the whole picture"],
        ["o", "1:1"],
        ["← → ↑ ↓", "move the picture"],
        ...switches.filter(([name]) => buttons.has(name)).map(([, , key, says]) => /** @type {[string, string]} */ ([key, says.toLowerCase()])),
        ...(on.heat ? [/** @type {[string, string]} */ (["c", "clear the false features"])] : []),
        ...(on.paint ? PAINT_HELP : []),
      ];
    },
    /** @param {KeyboardEvent} event */
    key(event) {
      if (on.paint && paintKey(event)) return true;
      const act = keys[event.key];
      if (act) act();
      return act !== undefined;
    },
  };
}

/** @type {[string, string][]} */
const PAINT_HELP = [
  ["← → ↑ ↓", "move the pointer; with Shift by one pixel"],
  ["space", "set a corner"],
  ["Enter", "close the mask"],
  ["Backspace", "take the last corner back"],
  ["n", "choose the next mask"],
  ["Delete", "remove the chosen mask"],
  ["Esc", "give up, then leave painting"],
];
