// @ts-check
// One node: what it is, its ports, its settings, and the newest message of a topic.
import { clock, make, write } from "./dom.js";
import { CLOUDS } from "./room_data.js";
import { settingsEditor } from "./settings.js";
import { tree } from "./tree.js";

const VALUE_HZ = 4;
const PICTURE_PX = 64;

/** How a topic is requested when only its head is to be seen. @param {string} message @returns {"picture"|"points"|"mesh"|"value"} */
function kindOf(message) {
  if (message === "image" || message === "silhouette") return "picture";
  if (message === "mesh") return "mesh";
  if (CLOUDS.includes(message)) return "points";
  return "value";
}

/** @param {import("./main.js").Context} context @param {number} node */
export function nodePanel(context, node) {
  const { hello } = context;
  const { name, type, role, summary, instances, scale } = hello.nodes[node];
  const topics = hello.topics.map((topic, id) => ({ ...topic, id })).filter((topic) => hello.instances[topic.instance].node === node);
  const ports = [...new Set(topics.map((topic) => topic.port))];
  const inputs = [...new Set(hello.edges.filter((edge) => hello.instances[edge.to[0]].node === node).map((edge) => `${edge.input} ← ${nodeAndPort(edge)}${edge.feedback ? " ↺" : ""}`))];
  const editor = settingsEditor(context, node);
  const message = tree();
  const when = make("p", { class: "dim" });
  let shown = topics[0]?.id ?? null;

  /** @param {import("./link.js").Edge} edge */
  function nodeAndPort(edge) {
    return `${hello.nodes[hello.instances[edge.from[0]].node].name}.${hello.topics[edge.topic]?.port ?? ""}`;
  }

  const list = make("select", { "aria-label": "Topic", onchange: () => choose(Number(list.value)) }, ...topics.map((topic) => make("option", { value: topic.id }, topic.path)));

  /** @param {number} topic */
  function choose(topic) {
    shown = topic;
    message.clear();
    write(when, "nothing has come yet");
    context.changed();
  }
  write(when, "nothing has come yet");

  const outputs = ports.map((port) => {
    const { message: what, owner, unit } = /** @type {any} */ (topics.find((topic) => topic.port === port));
    return `${port}: ${what}${unit && unit !== "–" ? ` [${unit}]` : ""}, ${owner}`;
  });
  const lines = (/** @type {string} */ title, /** @type {string[]} */ words) => (words.length ? make("div", {}, make("h4", {}, title), make("ul", {}, ...words.map((it) => make("li", {}, it)))) : null);
  const element = make(
    "div",
    { class: "node" },
    make("h3", {}, name),
    make("p", { class: "dim" }, `${type} · ${role} · ${hello.scales[scale]?.name ?? ""}${instances.length > 1 ? ` · ${instances.length} instances` : ""}`),
    summary ? make("p", {}, summary) : null,
    editor.element,
    lines("takes", inputs),
    lines("gives", outputs),
    ...(topics.length ? [make("h4", {}, "newest message"), list, when, message.element] : []),
  );

  return {
    element,
    settings: editor.settings,
    /** @returns {import("./main.js").Subscription[]} */
    wants() {
      if (shown === null) return [];
      const as = kindOf(hello.topics[shown].message);
      return [{ topic: shown, as, hz: VALUE_HZ, ...(as === "picture" ? { width: PICTURE_PX } : {}) }];
    },
    /** @param {import("./main.js").Frame} frame */
    frame(frame) {
      if (frame.topic !== shown) return;
      const more = frame.payload.length ? `, and ${frame.payload.length} bytes that are not shown here` : "";
      write(when, `${clock(frame.time_s, 3)}, number ${frame.sequence}${more}`);
      message.show(hello.topics[shown].message, frame.header);
    },
  };
}
