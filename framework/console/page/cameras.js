// @ts-check
// All cameras at once: their pictures, what was found in them, and how they arrive.
import { make } from "./dom.js";
import { servedCameras } from "./lookup.js";
import { tile } from "./camera_tile.js";
import { largeCamera } from "./camera_large.js";

const PICTURE_HZ = 10;
/** More often than pictures, so that those of the picture that is shown are there. */
const FEATURE_HZ = 30;
const SILHOUETTE_HZ = 15;
const GAP_PX = 6;
const NARROW_PX = 600;
const LEAST_TILE_PX = 150;
/** Widths of pictures are asked in these steps, so that dragging a window's edge does not ask anew with each pixel. */
const WIDTH_STEP_PX = 160;

/**
 * Columns and width of tiles so that all fit without scrolling and are as large as they can be.
 * @param {number[]} shapes height over width of each picture @param {number} width @param {number} height @param {number} caption height of a tile's caption
 */
export function arrange(shapes, width, height, caption) {
  let best = { columns: 1, tile: 0 };
  for (let columns = 1; columns <= shapes.length; columns++) {
    let rows = 0;
    let tall = 0;
    for (let i = 0; i < shapes.length; i += columns) {
      rows++;
      tall += Math.max(...shapes.slice(i, i + columns));
    }
    const across = (width - GAP_PX * (columns - 1)) / columns;
    const down = (height - rows * caption - GAP_PX * (rows - 1)) / tall;
    const tile = Math.floor(Math.min(across, down));
    if (tile > best.tile) best = { columns, tile };
  }
  if (width >= NARROW_PX && best.tile >= LEAST_TILE_PX) return best;
  const columns = width < NARROW_PX ? Math.min(2, shapes.length) : Math.max(1, Math.floor(width / (LEAST_TILE_PX + GAP_PX)));
  return { columns, tile: Math.floor((width - GAP_PX * (columns - 1)) / columns) };
}

/** @type {import("./main.js").ViewModule} */
export const view = {
  id: "cameras",
  title: "Cameras",
  key: "1",
  create(context) {
    const cameras = servedCameras(context.hello);
    const tiles = cameras.map((camera) => tile(context, camera));
    const grid = make("div", { class: "grid", role: "listbox", "aria-label": "Cameras", "aria-orientation": "horizontal" }, ...tiles.map((it) => it.element));
    const nothing = make("p", { class: "empty" }, "There is no camera to show.");
    const element = make("div", { class: "cameras" }, cameras.length ? grid : nothing);
    /** @type {Map<number, (frame: import("./main.js").Frame) => void>} */
    const takers = new Map();
    cameras.forEach((camera, index) => {
      if (camera.image !== null) takers.set(camera.image, tiles[index].picture);
      if (camera.silhouette !== null) takers.set(camera.silhouette, tiles[index].silhouette);
      for (const topic of camera.features) takers.set(topic, tiles[index].features);
    });
    /** @type {ReturnType<typeof largeCamera>|null} */
    let large = null;
    let columns = 1;
    let width = WIDTH_STEP_PX;
    let chosen = -1;
    const sized = new ResizeObserver(() => layout());

    function layout() {
      if (large) {
        large.resize();
        return;
      }
      if (!cameras.length || !element.clientWidth) return;
      const style = getComputedStyle(element);
      const across = element.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight);
      const down = element.clientHeight - parseFloat(style.paddingTop) - parseFloat(style.paddingBottom);
      const plan = arrange(cameras.map(({ size }) => size[1] / size[0]), across, down, parseFloat(context.css("--caption")));
      columns = plan.columns;
      grid.style.setProperty("--columns", String(columns));
      grid.style.setProperty("--tile", `${plan.tile}px`);
      for (const it of tiles) it.resize(plan.tile);
      const wide = Math.ceil((plan.tile * devicePixelRatio) / WIDTH_STEP_PX) * WIDTH_STEP_PX;
      if (wide !== width) {
        width = wide;
        context.changed();
      }
    }

    /** Shows what is chosen, here or in another view. */
    function mark() {
      if (chosen === (context.chosen.camera ?? -1)) return;
      chosen = context.chosen.camera ?? -1;
      tiles.forEach((it, index) => it.choose(index === chosen));
    }

    /** @param {number} index @param {boolean} [focus] */
    function choose(index, focus = true) {
      context.choose({ camera: index });
      mark();
      if (focus) tiles[index].element.focus();
      tiles[index].element.scrollIntoView({ block: "nearest" });
    }

    /** @param {number} index */
    function enlarge(index) {
      choose(index, false);
      large?.hide();
      large = largeCamera(context, cameras[index], {
        back: shrink,
        by: (step) => enlarge((index + step + cameras.length) % cameras.length),
        picture: tiles[index].last,
      });
      element.replaceChildren(large.element);
      element.classList.add("one");
      large.show();
      if (context.state) large.state(context.state);
      context.changed();
    }

    function shrink() {
      large?.hide();
      large = null;
      element.replaceChildren(grid);
      element.classList.remove("one");
      layout();
      choose(Math.max(0, chosen));
      if (context.state) for (const it of tiles) it.state(context.state);
      context.changed();
    }

    cameras.forEach((_, index) => {
      tiles[index].element.addEventListener("click", () => (context.chosen.camera === index ? enlarge(index) : choose(index)));
      tiles[index].element.addEventListener("focus", () => choose(index, false));
      // The focus that a click gives must not count as an earlier choice.
      tiles[index].element.addEventListener("mousedown", (/** @type {MouseEvent} */ event) => event.preventDefault());
    });
    if (tiles.length) tiles[0].element.tabIndex = 0;

    return {
      element,
      wants() {
        if (large) return large.wants();
        return cameras.flatMap((camera) => [
          ...(camera.image === null ? [] : [{ topic: camera.image, as: /** @type {const} */ ("picture"), width, hz: PICTURE_HZ }]),
          ...(camera.silhouette === null ? [] : [{ topic: camera.silhouette, as: /** @type {const} */ ("picture"), width, hz: SILHOUETTE_HZ }]),
          ...camera.features.map((topic) => ({ topic, as: /** @type {const} */ ("value"), hz: FEATURE_HZ })),
        ]);
      },
      frame(frame) {
        if (large) large.frame(frame);
        else takers.get(frame.topic)?.(frame);
      },
      state(state) {
        if (large) large.state(state);
        else for (const it of tiles) it.state(state);
      },
      settings(node, values) {
        large?.settings(node, values);
        for (const it of tiles) it.changed();
      },
      draw(now) {
        if (large) {
          large.draw(now);
          return;
        }
        mark();
        for (const it of tiles) it.draw(now);
      },
      show() {
        sized.observe(element);
        window.addEventListener("resize", layout);
        layout();
        large?.show();
        for (const it of tiles) it.show();
      },
      hide() {
        sized.disconnect();
        window.removeEventListener("resize", layout);
        large?.hide();
      },
      get help() {
        if (large) return large.help;
        return /** @type {[string, string][]} */ ([
          ["← → ↑ ↓", "choose a camera"],
          ["Enter", "enlarge it"],
          ["Home End", "first, last camera"],
        ]);
      },
      key(event) {
        if (large) return large.key(event);
        if (!cameras.length) return false;
        const step = /** @type {Record<string, number>} */ ({ ArrowRight: 1, ArrowLeft: -1, ArrowDown: columns, ArrowUp: -columns })[event.key];
        if (step !== undefined) {
          const next = chosen < 0 ? 0 : chosen + step;
          if (next >= 0 && next < cameras.length) choose(next);
        } else if (event.key === "Home") choose(0);
        else if (event.key === "End") choose(cameras.length - 1);
        else if (event.key === "Enter" && chosen >= 0) enlarge(chosen);
        else return false;
        return true;
      },
    };
  },
};
