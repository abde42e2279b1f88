// @ts-check
// The shell: link, tabs, keys, and the one view that is shown.
import { clock, make, number, plural, write } from "./dom.js";
import { connect } from "./link.js";
import { helpSheet } from "./help.js";
import { timeBar } from "./time.js";
import { theme } from "./theme.js";
import { view as calibrating } from "./calibrating.js";
import { view as cameras } from "./cameras.js";
import { view as health } from "./health.js";
import { view as marks } from "./marks.js";

/** @typedef {import("./link.js").Hello} Hello */
/** @typedef {import("./link.js").State} State */
/** @typedef {import("./link.js").Frame} Frame */
/** @typedef {import("./link.js").Answer} Answer */
/** @typedef {import("./link.js").Subscription} Subscription */
/** @typedef {{camera: number|null, target: number|null, mark: number|null}} Chosen */

/**
 * What a view is given.
 * @typedef {object} Context
 * @property {Hello} hello
 * @property {State|null} state The last one.
 * @property {(words: object) => Promise<Answer>} command
 * @property {() => void} changed The subscriptions are to be asked again.
 * @property {(what: Partial<Chosen>) => void} choose
 * @property {Chosen} chosen What is chosen in all views.
 * @property {(words: string) => void} say
 * @property {() => "dark"|"light"} theme
 * @property {(name: string) => string} css Value of a custom property.
 */

/**
 * @typedef {object} View
 * @property {HTMLElement} element
 * @property {() => Subscription[]} wants
 * @property {(frame: Frame) => void} frame
 * @property {(state: State) => void} state
 * @property {(node: number, values: Record<string, any>) => void} [settings]
 * @property {(name: string, value: any) => void} [sheet] What the program shows beside the run, also what came before the view was made.
 * @property {(now_ms: number) => void} draw
 * @property {() => void} show
 * @property {() => void} hide
 * @property {[string, string][]} help
 * @property {(event: KeyboardEvent) => boolean} key
 */

/**
 * @typedef {object} ViewModule
 * @property {string} id
 * @property {string} title
 * @property {string} key
 * @property {(context: Context) => View} create
 * @property {(hello: Hello, sheets: ReadonlyMap<string, any>) => boolean} [isThere] Whether it has anything to show; left out: always.
 * @property {string} [opensWith] The sheet whose coming opens it, unless another view was chosen by hand.
 */

const VERSION = 1;
const SAID_FOR_MS = 8000;

/** @param {string} id @returns {any} */
const place = (id) => document.getElementById(id);

/** The 3D view, or none where its file is missing or fails: the others work without. @returns {Promise<ViewModule[]>} */
async function room() {
  try {
    return [(await import("./room.js")).view];
  } catch (error) {
    say(`The room cannot be shown: ${error instanceof Error ? error.message : error}`);
    return [];
  }
}

/** @type {Hello|null} */
let hello = null;
/** @type {State|null} */
let state = null;
/** @type {Context|null} */
let context = null;
/** @type {"connecting"|"open"|"lost"|"error"} */
let linked = "connecting";
/** @type {Map<string, View>} */
let made = new Map();
/** @type {View|null} */
let shown = null;
let wanted = cameras.id;
let isWantedByHand = false;
/** @type {Map<string, any>} */
const sheets = new Map();
let refusal = "";
let subscribed = "";
let asking = false;
let saidTimer = 0;
/** @type {Chosen} */
const chosen = { camera: null, target: null, mark: null };

/** @param {string} words */
function say(words) {
  write(place("status"), words);
  clearTimeout(saidTimer);
  saidTimer = setTimeout(() => write(place("status"), ""), SAID_FOR_MS);
}

/** @type {ViewModule[]} */
const views = [cameras, ...(await room()), health, calibrating, marks];

const link = connect({
  hello: greet,
  state(now) {
    state = now;
    if (context) context.state = now;
    shown?.state(now);
    time.state(now);
    report();
  },
  settings(node, values) {
    for (const setting of hello?.nodes[node]?.settings ?? []) if (setting.name in values) setting.value = values[setting.name];
    for (const view of made.values()) view.settings?.(node, values);
  },
  sheet: take,
  refused(words) {
    refusal = words;
    linked = "error";
    report();
  },
  frame: (frame) => shown?.frame(frame),
  lost() {
    // Who was refused reads why, until the program lets it in.
    if (linked !== "connecting" && linked !== "error") linked = "lost";
    subscribed = "";
    report();
  },
});

const time = timeBar(place("time"), { command: order, say });
const sheet = helpSheet();
/** @type {Map<string, string>} Reading a style each time would cost more than drawing with it. */
const styles = new Map();
window.addEventListener("resize", () => styles.clear());
// Pictures depend on the colours, and are drawn again as for a new size.
const look = theme(() => window.dispatchEvent(new Event("resize")));

/** @param {string} name */
function css(name) {
  const known = styles.get(name);
  if (known !== undefined) return known;
  const value = getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  styles.set(name, value);
  return value;
}

/** A command whose refusal is shown. @param {object} words */
async function order(words) {
  const answer = await link.command(words);
  if (answer.words) say(answer.words);
  return answer;
}

/** Whether two rigs differ in nothing but the values of settings: then views stay as they are. @param {Hello} a @param {Hello} b */
function alike(a, b) {
  const shape = (/** @type {Hello} */ it) => JSON.stringify(it, (key, value) => (key === "value" ? undefined : value));
  return shape(a) === shape(b);
}

/** @param {Hello} greeting */
function greet(greeting) {
  const isAnew = linked !== "open";
  refusal = "";
  if (greeting.version !== VERSION) {
    linked = "error";
    report();
    return;
  }
  linked = "open";
  if (hello && alike(hello, greeting)) {
    greeting.nodes.forEach((node, index) => {
      const values = Object.fromEntries(node.settings.map(({ name, value }) => [name, value]));
      for (const setting of hello?.nodes[index].settings ?? []) setting.value = values[setting.name];
      for (const view of made.values()) view.settings?.(index, values);
    });
    subscribe();
    report();
    return;
  }
  // What an earlier program showed is not this one's.
  if (hello && isAnew) sheets.clear();
  hello = greeting;
  state = null;
  Object.assign(chosen, { camera: null, target: null, mark: null });
  shown?.hide();
  shown = null;
  made = new Map();
  context = {
    hello,
    state,
    command: link.command,
    changed: subscribe,
    choose: (what) => void Object.assign(chosen, what),
    chosen,
    say,
    theme: () => look.now,
    css,
  };
  time.hello(hello);
  open();
  report();
}

/** @param {string} name @param {any} value */
function take(name, value) {
  const isFirst = !sheets.has(name);
  sheets.set(name, value);
  for (const view of made.values()) view.sheet?.(name, value);
  if (isFirst) open();
}

const isThere = (/** @type {ViewModule} */ module) => !module.isThere || (hello !== null && module.isThere(hello, sheets));

/** Shows the view that is wanted, or what opens by itself, with the tabs of those that have anything to show. */
function open() {
  for (const tab of place("tabs").children) tab.hidden = !views.some((it) => it.id === tab.dataset.view && isThere(it));
  const opened = isWantedByHand ? undefined : views.find((it) => it.opensWith !== undefined && sheets.has(it.opensWith));
  const module = opened ?? views.find((it) => it.id === wanted);
  show(module && isThere(module) ? module.id : cameras.id);
}

/** @param {string} id */
function choose(id) {
  isWantedByHand = true;
  show(id);
}

/** @param {string} id */
function show(id) {
  wanted = id;
  const module = views.find((it) => it.id === id);
  document.body.dataset.view = id;
  for (const tab of place("tabs").children) {
    tab.setAttribute("aria-selected", String(tab.dataset.view === id));
    tab.tabIndex = tab.dataset.view === id ? 0 : -1;
  }
  if (!context || !module) return;
  let view = made.get(id);
  if (!view) {
    view = module.create(context);
    made.set(id, view);
    for (const [name, value] of sheets) view.sheet?.(name, value);
  }
  if (view === shown) return;
  shown?.hide();
  shown = view;
  place("view").replaceChildren(view.element);
  place("view").setAttribute("aria-label", module.title);
  view.show();
  if (state) view.state(state);
  subscribe();
  turn();
}

/** Sends the subscriptions of the view that is shown, if they have changed. Several calls at once send them once. */
function subscribe() {
  if (asking) return;
  asking = true;
  queueMicrotask(() => {
    asking = false;
    const topics = document.hidden || !shown ? [] : shown.wants();
    const words = JSON.stringify(topics);
    if (words !== subscribed && link.tell({ do: "subscribe", topics })) subscribed = words;
  });
}

let turning = false;
/** One turn a picture of the screen while a view is shown. */
function turn() {
  if (turning) return;
  turning = true;
  requestAnimationFrame((now) => {
    turning = false;
    if (!shown || document.hidden) return;
    shown.draw(now);
    turn();
  });
}

/** What the page is in, as a word for tests and style. */
function phase() {
  if (linked !== "open") return linked;
  if (hello && hello.cameras.length === 0) return "empty";
  return state?.phase ?? "starting";
}

/** @type {Record<string, () => string>} */
const notices = {
  connecting: () => "Connecting to the program …",
  empty: () => `This rig has no cameras. Add a camera source to ${hello?.rig.path} and start it again.`,
  lost: () => "The program does not answer. What you see is the last that came; the page tries again by itself.",
  error: () => refusal || "The program speaks another version of the protocol than this page. Reload the page.",
  finished: () => "The run has ended; what you see is its last state.",
};
const MODES = /** @type {Record<string, string>} */ ({ simulated: "simulated", live: "live", session: "recorded session" });

/** Writes what the frame of the page shows: top bar, notice, faults. */
function report() {
  const now = phase();
  document.body.dataset.phase = now;
  const notice = notices[now]?.() ?? "";
  write(place("notice"), notice);
  place("notice").hidden = notice === "";
  if (!hello) return;
  write(place("rig"), hello.rig.name);
  document.title = `${hello.rig.name} – Foveate console`;
  const length = hello.rig.duration_s === null ? "" : ` of ${clock(hello.rig.duration_s, 0)}`;
  const facts = [MODES[hello.rig.mode] ?? hello.rig.mode, linked === "lost" ? "no answer" : (state?.phase ?? "starting"), state ? clock(state.now_s) + length : "–"];
  if (linked === "open" && state?.phase === "running" && state.speed !== null) facts.push(`${number(state.speed, 2)} × real time`);
  if (linked === "open" && state) facts.push(plural(state.viewers, "viewer"));
  if (state?.recording) facts.push(`recording to ${state.recording.path.split(/[\\/]/).at(-1)}`);
  while (place("facts").children.length < facts.length) place("facts").append(make("span"));
  while (place("facts").children.length > facts.length) place("facts").lastChild.remove();
  facts.forEach((words, index) => write(place("facts").children[index], words));
  const last = state?.faults.at(-1);
  const faults = place("faults");
  write(faults, state && last ? `⚠ ${plural(state.n_faults, "fault")}, the last: ${last.who}: ${last.what}` : "no faults");
  faults.classList.toggle("warn", Boolean(last));
}

function help() {
  if (sheet.open) {
    sheet.close();
    return;
  }
  const title = views.find((it) => it.id === wanted)?.title ?? "";
  /** @type {[string, string][]} */
  const everywhere = [...views.filter(isThere).map((it) => /** @type {[string, string]} */ ([it.key, it.title])), ["?", "this sheet"], ["Tab", "to the next control"]];
  sheet.show([
    { title, keys: shown?.help ?? [] },
    { title: "Time", keys: time.help() },
    { title: "Everywhere", keys: everywhere },
  ]);
}

/** Whether a key belongs to the control that has the focus. @param {KeyboardEvent} event */
function isTyping(event) {
  const at = event.target;
  if (!(at instanceof HTMLElement)) return false;
  if (at instanceof HTMLButtonElement || at.tagName === "SUMMARY") return event.key === " " || event.key === "Enter";
  if (at instanceof HTMLInputElement && at.type === "checkbox") return event.key === " ";
  if (at instanceof HTMLInputElement && at.type === "range") return /^(Arrow|Page|Home|End)/.test(event.key);
  return at instanceof HTMLInputElement || at instanceof HTMLSelectElement || at instanceof HTMLTextAreaElement;
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (sheet.open) {
    if (event.key === "?") sheet.close();
    return;
  }
  if (event.target instanceof HTMLElement && event.key === "Escape" && isTyping(event)) {
    event.target.blur();
    return;
  }
  if (isTyping(event)) return;
  const module = views.find((it) => it.key === event.key && isThere(it));
  const taken = shown?.key(event) || time.key(event) || (event.key === "?" ? (help(), true) : module ? (choose(module.id), true) : false);
  if (taken) event.preventDefault();
});

// A click leaves the focus where it is, so that the keys of the view go on working.
document.addEventListener("mousedown", (event) => {
  if (event.target instanceof Element && event.target.closest("button")) event.preventDefault();
});

for (const module of views) {
  place("tabs").append(
    make("button", { type: "button", role: "tab", "data-view": module.id, "aria-controls": "view", "aria-selected": "false", "aria-keyshortcuts": module.key, hidden: module.isThere !== undefined, onclick: () => choose(module.id) }, module.title, make("kbd", {}, module.key)),
  );
}
place("tabs").addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
  const by = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (!by) return;
  const there = views.filter(isThere);
  const next = there[(there.findIndex((it) => it.id === wanted) + by + there.length) % there.length];
  choose(next.id);
  place("tabs").children[views.indexOf(next)].focus();
  event.preventDefault();
  event.stopPropagation();
});
place("switches").append(look.button, make("button", { type: "button", class: "quiet", "aria-keyshortcuts": "?", onclick: help }, "Keys", make("kbd", {}, "?")));
place("faults").addEventListener("click", () => choose(health.id));
document.addEventListener("visibilitychange", () => {
  subscribe();
  turn();
});
show(wanted);
report();
