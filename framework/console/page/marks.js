// @ts-check
// Marks by hand, as of Davis (2002): one camera large, the others in a strip, and beside them what is wrong and what was corrected.
import { tile } from "./camera_tile.js";
import { make, number, write } from "./dom.js";
import { servedCameras, setting, traffic } from "./lookup.js";
import { markEditor } from "./marks_editor.js";
import { inOrder, marksList } from "./marks_list.js";
import { rowBook } from "./marks_rows.js";

const PICTURE_HZ = 20;
/** As often as they come, so that those of each picture are there. */
const FEATURE_HZ = 60;
const STRIP_HZ = 3;
const STRIP_PX = 150;
const STRIP_WIDTH_PX = 160;

/** Nodes whose marks can be corrected. @param {import("./main.js").Hello} hello */
const corrected = (hello) => [...hello.nodes.keys()].filter((node) => setting(hello, node, "corrections")?.live);

/** @type {import("./main.js").ViewModule} */
export const view = {
  id: "marks",
  title: "Marks",
  key: "5",
  isThere: (hello) => hello.rig.can.correct && corrected(hello).length > 0,
  create(context) {
    const { hello } = context;
    const isSession = hello.rig.mode === "session";
    const served = servedCameras(hello);
    const nodes = corrected(hello);
    let node = nodes[0];
    /** @type {import("./lookup.js").Served[]} Of the node. */
    let cameras = [];
    /** @type {Map<number, number>} Topics of features, and the cameras that they are of. */
    let topics = new Map();
    /** @type {ReturnType<typeof tile>[]} */
    let tiles = [];
    /** @type {Map<number, Set<number>>} Numbers that each camera knows. */
    let numbers = new Map();
    let at = 0;
    /** @type {ReturnType<typeof markEditor>|null} */
    let editor = null;
    let isShown = false;
    /** @type {import("./marks_rows.js").Problem|null} */
    let problem = null;

    const book = rowBook(context, () => {
      showRows();
      editor?.tell();
    });
    const choice = make("select", { "aria-label": "Node", hidden: nodes.length < 2, onchange: () => enter(Number(choice.value)) }, ...nodes.map((id) => make("option", { value: id }, hello.nodes[id].name)));
    const title = make("b");
    const facts = make("span", { class: "dim" });
    const bar = make("div", { class: "camera-bar", role: "toolbar", "aria-label": "Marks" });
    const strip = make("div", { class: "strip", role: "listbox", "aria-label": "Cameras", "aria-orientation": "horizontal" });
    const left = make("div", { class: "marks-left" });
    const list = marksList(context, {
      problem: reach,
      choose: (row) => go(row.camera, row.mark),
      remove: (row) => void book.send(row.node ?? node, [{ ...row, remove: true }]),
      again,
      search: () => void order({ do: "problems", node }),
    });
    const lens = make("div");
    const panel = make("aside", { class: "panel", "aria-label": "Problems and rows" }, lens, list.element);
    const row = make("div", { class: "large-row" }, left, panel);
    const element = make("div", { class: "large marks" });

    /** @param {object} words */
    async function order(words) {
      const answer = await context.command(words);
      if (answer.words) context.say(answer.words);
    }

    function again() {
      editor?.settle();
      if (isSession) void order({ do: "again" });
    }

    function showRows() {
      list.show(book.sheet, book.rows().filter((it) => it.node === node), node);
    }

    /** @param {number} id */
    function enter(id) {
      node = id;
      choice.value = String(id);
      const own = hello.nodes[id].instances;
      topics = new Map();
      hello.topics.forEach(({ instance, message, camera }, topic) => {
        if (message === "features" && camera !== null && own.includes(instance)) topics.set(topic, camera);
      });
      cameras = served.filter((it) => [...topics.values()].includes(it.index)).map((it) => ({ ...it, features: it.features.filter((topic) => topics.has(topic)), silhouette: null }));
      numbers = new Map();
      tiles = cameras.map((it) => tile(context, it));
      tiles.forEach((it, index) => {
        it.element.addEventListener("click", () => enlarge(index));
        it.element.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
          if (event.key !== "Enter" && event.key !== " ") return;
          enlarge(index);
          event.preventDefault();
          event.stopPropagation();
        });
      });
      strip.replaceChildren(...tiles.map((it) => it.element));
      if (isShown) showTiles();
      showRows();
      const wanted = cameras.findIndex((it) => it.index === context.chosen.camera);
      if (cameras.length) enlarge(Math.max(0, wanted));
      else element.replaceChildren(make("p", { class: "empty" }, `${hello.nodes[id].name} has no camera whose marks are shown.`));
    }

    function showTiles() {
      for (const it of tiles) {
        it.resize(STRIP_PX);
        it.show();
      }
    }

    /** @param {number} index */
    function enlarge(index) {
      editor?.settle();
      editor?.stage.hide();
      at = index;
      const camera = cameras[index];
      context.choose({ camera: camera.index });
      const made = markEditor(context, camera, { node, features: camera.features, book, known: () => new Set([...numbers.values()].flatMap((it) => [...it])) });
      editor = made;
      tiles.forEach((it, other) => it.choose(other === index));
      tiles[index].element.scrollIntoView({ block: "nearest", inline: "nearest" });
      write(title, camera.name);
      bar.replaceChildren(choice, title, facts, made.tools, made.stage.tools);
      left.replaceChildren(made.stage.element, strip);
      lens.replaceChildren(made.lens);
      element.replaceChildren(bar, made.note, row);
      if (isShown) made.stage.show();
      made.tell();
      if (context.state) state(context.state);
      context.changed();
    }

    /** @param {number} camera @param {number} mark */
    function go(camera, mark) {
      const index = cameras.findIndex((it) => it.index === camera);
      context.choose({ mark });
      if (index >= 0 && index !== at) enlarge(index);
      else editor?.tell();
    }

    /** @param {import("./marks_rows.js").Problem} to */
    function reach(to) {
      problem = to;
      go(to.camera, to.mark);
      if (hello.rig.can.seek) void order({ do: "seek", to_s: to.at_s });
    }

    /** @param {number} by */
    function nextProblem(by) {
      const all = inOrder(book.sheet?.node === node ? book.sheet.problems : []);
      if (!all.length) return;
      const key = JSON.stringify(problem);
      const index = all.findIndex((it) => JSON.stringify(it) === key);
      reach(all[index < 0 ? 0 : (index + by + all.length) % all.length]);
    }

    /** @param {import("./main.js").State} now */
    function state(now) {
      editor?.state(now);
      for (const it of tiles) it.state(now);
      const camera = cameras[at];
      if (camera) write(facts, `${camera.size[0]} × ${camera.size[1]} px · ${number(traffic(now, camera).rate)}/s`);
    }

    /** @type {Record<string, () => void>} */
    const keys = {
      p: () => nextProblem(1),
      P: () => nextProblem(-1),
      t: again,
      PageDown: () => enlarge((at + 1) % cameras.length),
      PageUp: () => enlarge((at - 1 + cameras.length) % cameras.length),
    };

    return {
      element,
      wants() {
        return cameras.flatMap((camera, index) => {
          const isLarge = index === at;
          const image = camera.image === null ? [] : [{ topic: camera.image, as: /** @type {const} */ ("picture"), width: isLarge ? 0 : STRIP_WIDTH_PX, hz: isLarge ? PICTURE_HZ : STRIP_HZ }];
          return [...image, ...camera.features.map((topic) => ({ topic, as: /** @type {const} */ ("value"), hz: isLarge ? FEATURE_HZ : STRIP_HZ }))];
        });
      },
      frame(frame) {
        const index = cameras.findIndex((it) => it.image === frame.topic || it.features.includes(frame.topic));
        if (index < 0) return;
        if (index === at) editor?.frame(frame);
        if (frame.kind === "picture") tiles[index].picture(frame);
        else {
          tiles[index].features(frame);
          const labels = (frame.header.list ?? []).map((/** @type {{label: number|null}} */ it) => it.label).filter((/** @type {number|null} */ label) => label !== null && label !== undefined);
          numbers.set(index, new Set(labels));
        }
      },
      state,
      sheet(name, value) {
        if (name === "marks") book.take(value);
      },
      draw(now) {
        editor?.draw();
        for (const it of tiles) it.draw(now);
      },
      show() {
        isShown = true;
        const wanted = cameras.findIndex((it) => it.index === context.chosen.camera);
        if (!editor) enter(node);
        else if (wanted >= 0 && wanted !== at) enlarge(wanted);
        else editor.stage.show();
        showTiles();
        editor?.tell();
      },
      hide() {
        isShown = false;
        editor?.settle();
        editor?.stage.hide();
      },
      help: [
        ["j k", "choose the next mark, the one before"],
        ["u", "choose the next dot without a number"],
        ["n", "give the chosen place a number"],
        ["r", "give the chosen mark another number"],
        ["m", "merge the chosen mark into the next one that is clicked"],
        ["s", "swap it with the next one that is clicked"],
        ["Enter", "merge, swap: with the one that j k chose"],
        ["← → ↑ ↓", "move the chosen mark by 0.25 px, with Shift by 1 px"],
        ["Del", "the chosen mark is not visible from here on"],
        ["z", "take the last row back"],
        .../** @type {[string, string][]} */ (isSession ? [["p P", "the next problem, the one before"], ["t", "track again"]] : []),
        ["PageUp PageDown", "the camera before, after"],
        ["+ − wheel", "zoom"],
        ["0 o", "the whole picture, 1:1"],
        ["Esc", "give up, choose nothing"],
      ],
      key(event) {
        if (editor?.key(event)) return true;
        const act = keys[event.key];
        if (act && cameras.length) act();
        return act !== undefined;
      },
    };
  },
};
