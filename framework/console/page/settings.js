// @ts-check
// The settings of a node, and what of them is not saved yet. Those that are live act at once; the others are shown as they are.
import { make, write } from "./dom.js";

/** @typedef {import("./link.js").Setting} Setting */
/** @typedef {import("./main.js").Context} Context */

const SEND_EVERY_MS = 100;
/** What comes back while a control is moved is older than what it shows. */
const MOVED_WITHIN_MS = 600;
/** Longer ranges have no slider: a pixel of it would be too much. */
const LONGEST_SLIDER = 10_000;

const same = (/** @type {any} */ a, /** @type {any} */ b) => JSON.stringify(a) === JSON.stringify(b);
const isNumeric = (/** @type {Setting} */ it) => it.kind === "integer" || it.kind === "number";
const hasSlider = (/** @type {Setting} */ it) => isNumeric(it) && it.min !== null && it.max !== null && it.max - it.min <= LONGEST_SLIDER;
const short = (/** @type {any} */ value) => (typeof value === "number" ? String(Number(value.toPrecision(7))) : String(value));
const unitOf = (/** @type {Setting} */ it) => (it.unit && it.unit !== "–" && it.unit !== "-" ? it.unit : "");

/** The newest value at most ten times a second, and the last one always. @param {(value: any) => Promise<void>} send */
function paced(send) {
  let timer = 0;
  /** @type {{value: any}|null} */
  let next = null;
  function go() {
    if (!next) return;
    const { value } = next;
    next = null;
    timer = setTimeout(() => {
      timer = 0;
      go();
    }, SEND_EVERY_MS);
    void send(value);
  }
  return (/** @type {any} */ value) => {
    next = { value };
    if (!timer) go();
  };
}

/**
 * @param {Setting} setting @param {string} label @param {boolean} isOpen
 * @param {(value: any) => void} changed
 * @returns {{element: HTMLElement, show: (value: any) => void}}
 */
function control(setting, label, isOpen, changed) {
  const common = { "aria-label": label, "aria-description": setting.help, disabled: !isOpen };
  if (setting.kind === "boolean") {
    const box = make("input", { type: "checkbox", ...common, onchange: () => changed(box.checked) });
    return { element: box, show: (value) => (box.checked = Boolean(value)) };
  }
  if (setting.kind === "choice") {
    const list = make("select", { ...common, onchange: () => changed(list.value) }, ...(setting.choices ?? []).map((name) => make("option", { value: name }, name)));
    return { element: list, show: (value) => (list.value = String(value)) };
  }
  if (setting.kind === "json") {
    const text = make("code", { class: "json", tabindex: 0, "aria-label": label });
    return {
      element: text,
      show(value) {
        const words = JSON.stringify(value) ?? "";
        write(text, words.length > 160 ? `${words.slice(0, 160)} … (${Array.isArray(value) ? `${value.length} entries` : `${words.length} characters`})` : words);
      },
    };
  }
  if (setting.kind === "text") {
    const field = make("input", { type: "text", ...common, onchange: () => changed(field.value) });
    return { element: field, show: (value) => (field.value = value ?? "") };
  }
  const step = setting.kind === "integer" ? 1 : "any";
  const field = make("input", { type: "number", ...common, step, min: setting.min, max: setting.max });
  field.addEventListener("change", () => {
    if (field.value !== "" && Number.isFinite(field.valueAsNumber)) changed(setting.kind === "integer" ? Math.round(field.valueAsNumber) : field.valueAsNumber);
  });
  if (!hasSlider(setting)) return { element: field, show: (value) => (field.value = value === null ? "" : short(value)) };
  const span = Number(setting.max) - Number(setting.min);
  const slider = make("input", { type: "range", ...common, min: setting.min, max: setting.max, step: step === 1 ? 1 : span / 500 });
  slider.addEventListener("input", () => {
    field.value = short(slider.valueAsNumber);
    changed(Number(field.value));
  });
  return {
    element: make("span", { class: "slider" }, slider, field),
    show(value) {
      field.value = value === null ? "" : short(value);
      slider.value = String(value ?? setting.min);
    },
  };
}

/**
 * @param {Context} context @param {number} node
 * @param {(setting: Setting|null) => void} explain shows what a setting is, while it has the focus or the pointer
 */
function rowsOf(context, node, explain) {
  const { name: nodeName, settings } = context.hello.nodes[node];
  return settings.map((setting) => {
    const isOpen = setting.live && context.hello.rig.can.set;
    let moved = -Infinity;
    const refusal = make("span", { class: "refusal bad", hidden: true });
    const send = paced(async (value) => {
      const answer = await context.command({ do: "set", node, values: { [setting.name]: value } });
      write(refusal, answer.ok ? "" : `⚠ ${answer.words}`);
      refusal.hidden = answer.ok;
      if (!answer.ok) {
        moved = -Infinity;
        show();
      }
    });
    const { element: entry, show: showValue } = control(setting, `${nodeName} ${setting.name}${unitOf(setting) ? `, ${unitOf(setting)}` : ""}`, isOpen, (value) => {
      moved = performance.now();
      send(value);
    });
    const reset = make("button", { type: "button", class: "quiet reset", title: `Back to ${short(setting.kind === "json" ? JSON.stringify(setting.default) : setting.default)}`, "aria-label": `${setting.name}: back to its default`, disabled: !isOpen, onclick: () => send(setting.default) }, "changed ↺");
    const head = make("span", { class: "setting-name" }, setting.name, unitOf(setting) ? make("span", { class: "dim" }, ` ${unitOf(setting)}`) : null);
    const element = make("div", { class: "setting", title: setting.help, "data-setting": setting.name }, head, reset, entry, refusal);
    for (const event of ["focusin", "pointerenter"]) element.addEventListener(event, () => explain(setting));
    function show() {
      if (performance.now() - moved > MOVED_WITHIN_MS) showValue(setting.value);
      reset.hidden = same(setting.value, setting.default);
    }
    // What came while the control moved may be another value than the last one sent.
    element.addEventListener("focusout", () => setTimeout(show, MOVED_WITHIN_MS));
    show();
    return { setting, element, show };
  });
}

/**
 * @param {Context} context @param {number} node
 * @param {{isOpen?: boolean}} [options]
 */
export function settingsEditor(context, node, { isOpen = true } = {}) {
  const { name, type, settings } = context.hello.nodes[node];
  const help = make("p", { class: "setting-help dim", "aria-hidden": "true" });
  const rows = rowsOf(context, node, (setting) => write(help, setting ? `${setting.name}: ${setting.help}` : ""));
  const isKept = !context.hello.rig.can.set;
  const live = rows.filter((row) => row.setting.live && !isKept).map((row) => row.element);
  const fixed = rows.filter((row) => !row.setting.live || isKept).map((row) => row.element);
  const element = make(
    "details",
    { class: "settings", open: isOpen, "data-node": name },
    make("summary", {}, make("b", {}, name), make("span", { class: "dim" }, ` ${type}`)),
    ...(settings.length ? [] : [make("p", { class: "dim" }, "This node has no settings.")]),
    ...(live.length ? [make("h4", {}, "live"), ...live] : []),
    ...(isKept && settings.length ? [make("p", { class: "dim" }, "A recording keeps its settings.")] : []),
    ...(fixed.length && isKept ? fixed : []),
    ...(fixed.length && !isKept ? [make("details", { class: "fixed" }, make("summary", {}, `${fixed.length} fixed while it runs`), ...fixed)] : []),
    ...(settings.length ? [help] : []),
  );
  return {
    element,
    /** @param {number} changed @param {Record<string, any>} values */
    settings(changed, values) {
      if (changed === node) for (const row of rows) if (row.setting.name in values) row.show();
    },
  };
}

/** What is not saved, and the button that saves it. @param {Context} context */
export function saveBar(context) {
  const words = make("span");
  const button = make("button", { type: "button", class: "tool" }, "Save");
  const element = make("div", { class: "save", hidden: true }, words, button);
  button.addEventListener("click", async () => {
    const answer = await context.command({ do: "save" });
    context.say(answer.words || (answer.ok ? "Saved." : "Not saved."));
  });
  return {
    element,
    /** @param {import("./main.js").State} state */
    state({ unsaved }) {
      element.hidden = unsaved.length === 0;
      const can = context.hello.rig.can.save;
      button.hidden = !can;
      write(words, `${can ? `To be saved in ${context.hello.rig.path}` : "Changed, and lost with this run"}: ${unsaved.join(", ")}`);
    },
  };
}
