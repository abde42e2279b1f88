// @ts-check
// All cameras at once: their pictures, what was found in them, and how they arrive.
import { make } from "./dom.js";
import { arrange, budget, byShape } from "./arrange.js";
import { servedCameras } from "./lookup.js";
import { tile } from "./camera_tile.js";
import { largeCamera } from "./camera_large.js";

/** More often than pictures, so that those of the picture that is shown are there. */
const FEATURES_PER_PICTURE = 3;
const SILHOUETTES_PER_PICTURE = 1.5;

/** @type {import("./main.js").ViewModule} */
export const view = {
  id: "cameras",
  title: "Cameras",
  key: "1",
  create(context) {
    const served = servedCameras(context.hello);
    const shapes = served.map(({ size }) => size[1] / size[0]);
    const groups = byShape(shapes);
    /** In the order in which they stand. */
    const cameras = groups.flat().map((index) => served[index]);
    const tiles = cameras.map((camera) => tile(context, camera));
    const tileOf = new Map(cameras.map((camera, place) => [camera.index, tiles[place]]));
    const parts = groups.map((group) => make("div", { class: "grid", role: "presentation" }, ...group.map((index) => tileOf.get(index)?.element)));
    const grid = make("div", { class: "grids", role: "listbox", "aria-label": "Cameras", "aria-orientation": "horizontal" }, ...parts);
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
    let asked = budget(cameras.map(({ size }) => ({ size, shown: 1, layers: 1 })));
    /** Place of the chosen camera. */
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
      const plans = arrange(groups.map((group) => ({ shape: shapes[group[0]], n: group.length })), across, down, parseFloat(context.css("--caption")));
      plans.forEach(({ columns, tile }, index) => {
        parts[index].style.setProperty("--columns", String(columns));
        parts[index].style.setProperty("--tile", `${tile}px`);
      });
      const widths = groups.flatMap((group, index) => group.map(() => plans[index].tile));
      tiles.forEach((it, place) => it.resize(widths[place]));
      const before = JSON.stringify(asked);
      asked = budget(cameras.map(({ size, silhouette }, place) => ({ size, shown: widths[place] * devicePixelRatio, layers: silhouette === null ? 1 : 1 + SILHOUETTES_PER_PICTURE })));
      if (JSON.stringify(asked) !== before) context.changed();
    }

    /** Shows what is chosen, here or in another view. */
    function mark() {
      const now = cameras.findIndex(({ index }) => index === context.chosen.camera);
      if (chosen === now) return;
      chosen = now;
      tiles.forEach((it, index) => it.choose(index === chosen));
    }

    /** @param {number} place @param {boolean} [focus] */
    function choose(place, focus = true) {
      context.choose({ camera: cameras[place].index });
      mark();
      if (focus) tiles[place].element.focus();
      tiles[place].element.scrollIntoView({ block: "nearest" });
    }

    /** The tile nearest below or above. @param {number} by */
    function beside(by) {
      const boxes = tiles.map(({ element }) => [element.offsetLeft + element.offsetWidth / 2, element.offsetTop]);
      const [x, y] = boxes[chosen];
      const others = [...boxes.keys()].filter((place) => by * (boxes[place][1] - y) > 0);
      const far = (/** @type {number} */ place) => Math.abs(boxes[place][1] - y) * 1e3 + Math.abs(boxes[place][0] - x);
      return others.reduce((best, place) => (best < 0 || far(place) < far(best) ? place : best), -1);
    }

    /** @param {number} place */
    function enlarge(place) {
      choose(place, false);
      large?.hide();
      large = largeCamera(context, cameras[place], {
        back: shrink,
        by: (step) => enlarge((place + step + cameras.length) % cameras.length),
        picture: tiles[place].last,
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

    cameras.forEach((_, place) => {
      tiles[place].element.addEventListener("click", () => (chosen === place ? enlarge(place) : choose(place)));
      tiles[place].element.addEventListener("focus", () => choose(place, false));
      // The focus that a click gives must not count as an earlier choice.
      tiles[place].element.addEventListener("mousedown", (/** @type {MouseEvent} */ event) => event.preventDefault());
    });
    if (tiles.length) tiles[0].element.tabIndex = 0;

    return {
      element,
      wants() {
        if (large) return large.wants();
        const { widths, hz } = asked;
        return cameras.flatMap((camera, place) => [
          ...(camera.image === null ? [] : [{ topic: camera.image, as: /** @type {const} */ ("picture"), width: widths[place], hz }]),
          ...(camera.silhouette === null ? [] : [{ topic: camera.silhouette, as: /** @type {const} */ ("picture"), width: widths[place], hz: SILHOUETTES_PER_PICTURE * hz }]),
          ...camera.features.map((topic) => ({ topic, as: /** @type {const} */ ("value"), hz: FEATURES_PER_PICTURE * hz })),
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
        const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
        if (step || by) {
          const next = chosen < 0 ? 0 : step ? chosen + step : beside(Number(by));
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
