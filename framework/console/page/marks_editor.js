// @ts-check
// The marks of one camera, by hand: chosen, dragged, named, merged, swapped and ended in the picture that is shown.
import { ARROWS, cameraStage, tool } from "./camera_stage.js";
import { make, number, write } from "./dom.js";
import { drawMarks, magnifier } from "./marks_draw.js";
import { applied, freeNumber } from "./marks_rows.js";
import { heldFrames } from "./marks_held.js";
import { Matched } from "./matched.js";
import { noteLine } from "./marks_note.js";
import { Picture } from "./picture.js";

/** @typedef {import("./main.js").Frame} Frame */
/** @typedef {import("./marks_rows.js").Dot} Dot */
/** @typedef {import("./marks_rows.js").Row} Row */

const NEAR_PX = 9;
const NEAR_FINGER_PX = 18;
const NUDGE_PX = 0.25;
const NUDGE_FAR_PX = 1;
const REST_MS = 400;
const round = (/** @type {number} */ value) => Math.round(value * 1000) / 1000;

/**
 * @param {import("./main.js").Context} context
 * @param {import("./lookup.js").Served} camera
 * @param {{node: number, features: number[], book: ReturnType<typeof import("./marks_rows.js").rowBook>, known: () => Iterable<number>}} marks `known`: numbers that any camera of the node has
 */
export function markEditor(context, camera, { node, features, book, known }) {
  const { rig } = context.hello;
  const picture = new Picture();
  const found = new Map(features.map((topic) => [topic, new Matched()]));
  /** @type {Dot[]} */
  let dots = [];
  /** A place without a number. @type {{u: number, v: number}|null} */
  let spot = null;
  /** What the next click is for. @type {"merge"|"swap"|null} */
  let armed = null;
  /** @type {number|null} The other mark, chosen by keys. */
  let other = null;
  /** A mark that moves and is not sent yet. @type {Row|null} */
  let moving = null;
  let grabbed = [0, 0];
  let rest = 0;
  const held = heldFrames(take);
  let dirty = true;
  /** @type {{u: number, v: number}|null} */
  let pointer = null;

  const stage = cameraStage(context, camera, {
    changed: touch,
    over(u, v) {
      pointer = { u, v };
      touch();
    },
    out() {
      pointer = null;
      touch();
    },
    click: (u, v, event) => pick(nearest(u, v, event), u, v),
    hold: {
      grab(u, v, event) {
        const dot = nearest(u, v, event);
        if (armed || note.isAsking || !dot || dot.label === null) return false;
        settle();
        choose(dot.label);
        held.hold();
        grabbed = [dot.u - u, dot.v - v];
        return true;
      },
      drag(u, v) {
        pause();
        const mark = context.chosen.mark;
        if (mark !== null) moving = row(mark, u + grabbed[0], v + grabbed[1]);
        touch();
      },
      drop: settle,
      letGo() {
        moving = null;
        release();
      },
    },
  });
  const { canvas, pen, zoom } = stage;

  const note = noteLine({
    begin() {
      held.hold();
      tell();
    },
    end() {
      release();
      tell();
      canvas.focus({ preventScroll: true });
    },
  });
  const lens = make("canvas", { class: "lens", role: "img", "aria-label": "Magnifier" });
  const lensWords = make("p", { class: "dim lens-words" });
  const glass = magnifier(context, lens);
  const acts = {
    name: tool("Name", "n", name, "Give the chosen place a number"),
    rename: tool("Rename", "r", rename, "Give the chosen mark another number"),
    merge: tool("Merge", "m", () => arm("merge"), "Merge the chosen mark into the next one"),
    swap: tool("Swap", "s", () => arm("swap"), "Swap the chosen mark and the next one"),
    end: tool("End", "Del", end, "The chosen mark is not visible from here on"),
    undo: tool("Undo", "z", undo, "Take the last row back"),
  };

  function touch() {
    dirty = true;
  }

  const frameNow = () => picture.frame?.sequence ?? features.map((topic) => found.get(topic)?.best?.sequence).find((it) => it !== undefined) ?? null;
  const isRunning = () => context.state?.phase === "running";
  const chosen = () => (context.chosen.mark === null ? null : (dots.find((dot) => dot.label === context.chosen.mark) ?? null));
  /** @param {number} mark @param {number|null} u @param {number|null} v @returns {Row} */
  const row = (mark, u, v) => ({ camera: camera.index, mark, frame: frameNow() ?? 0, u: u === null ? null : round(u), v: v === null ? null : round(v) });

  function look() {
    const frame = frameNow();
    const rows = book.rows().filter((it) => it.node === node && it.camera === camera.index && it.frame === frame);
    const now = moving ? [...rows.filter((it) => it.mark !== moving?.mark), moving] : rows;
    dots = applied([...found.values()].flatMap((it) => it.best?.header.list ?? []), now);
  }

  /** The mark or dot under a hand; a finger is broader than a pointer. @param {number} u @param {number} v @param {PointerEvent} event */
  function nearest(u, v, event) {
    look();
    const reach = (event.pointerType === "touch" ? NEAR_FINGER_PX : NEAR_PX) / zoom.scale;
    const far = (/** @type {Dot} */ dot) => Math.hypot(dot.u - u, dot.v - v);
    return dots.reduce((best, dot) => (far(dot) < (best ? far(best) : reach) ? dot : best), /** @type {Dot|null} */ (null));
  }

  function pause() {
    if (!isRunning() || !rig.can.pause) return;
    void context.command({ do: "pause" });
    // Pictures that came until it stood would show the marks as they were.
    const shown = picture.frame;
    if (rig.can.seek && shown) void context.command({ do: "seek", to_s: shown.time_s });
  }

  function release() {
    if (held.release()) tell();
  }

  /** @param {Frame} frame */
  function take(frame) {
    if (frame.topic === camera.image) picture.take(frame);
    else found.get(frame.topic)?.take(frame);
    for (const it of found.values()) it.match(picture.frame?.time_s);
    touch();
  }

  /** @param {number|null} mark */
  function choose(mark) {
    context.choose({ mark });
    if (spot) release();
    spot = null;
    tell();
  }

  /** @param {Dot|null} dot @param {number} u @param {number} v */
  function pick(dot, u, v) {
    if (note.isAsking) return;
    settle();
    if (armed) {
      if (dot?.label === null || !dot || dot.label === context.chosen.mark) context.say("Click another mark that has a number; Escape gives up.");
      else both(dot.label);
      return;
    }
    if (dot && dot.label !== null) {
      choose(dot.label);
      return;
    }
    choose(null);
    // Of a picture that has gone by, a place would be another.
    pause();
    held.hold();
    spot = dot ? { u: dot.u, v: dot.v } : { u, v };
    tell();
  }

  /** @param {Row[]} rows */
  function send(rows) {
    void book.send(node, rows);
  }

  /** Sends a mark that has moved. */
  function settle() {
    clearTimeout(rest);
    const moved = moving;
    moving = null;
    if (moved) send([moved]);
    if (!spot && !armed) release();
    touch();
  }

  /** @param {string} question @param {number} proposed @param {(label: number) => void} then */
  function ask(question, proposed, then) {
    settle();
    pause();
    note.ask(question, proposed, then);
  }

  function name() {
    look();
    if (!spot) {
      context.say("Choose a place without a number first: click it, or u goes through them.");
      return;
    }
    const { u, v } = spot;
    ask("Number of this mark:", freeNumber(dots, known()), (number) => {
      send([row(number, u, v)]);
      choose(number);
    });
  }

  /** The chosen mark, or words that one is needed. */
  function needed() {
    settle();
    look();
    const dot = chosen();
    if (!dot) context.say("Choose a mark first: click it, or j and k go through them.");
    return dot;
  }

  function rename() {
    const dot = needed();
    if (!dot) return;
    const mark = Number(dot.label);
    ask(`New number of mark ${mark}:`, freeNumber(dots, known()), (number) => {
      if (number === mark) return;
      send([row(mark, null, null), row(number, dot.u, dot.v)]);
      choose(number);
    });
  }

  /** @param {"merge"|"swap"} what */
  function arm(what) {
    if (!needed()) return;
    pause();
    held.hold();
    armed = what;
    other = null;
    tell();
  }

  /** Merges into, or swaps with, this one. @param {number} label */
  function both(label) {
    look();
    const a = chosen();
    const b = dots.find((dot) => dot.label === label);
    if (a && b && armed === "merge") {
      send([row(Number(a.label), null, null)]);
      choose(label);
    } else if (a && b) send([row(Number(a.label), b.u, b.v), row(label, a.u, a.v)]);
    disarm();
  }

  function disarm() {
    armed = null;
    other = null;
    release();
    tell();
  }

  function end() {
    const dot = needed();
    if (!dot) return;
    pause();
    send([row(Number(dot.label), null, null)]);
    choose(null);
  }

  function undo() {
    settle();
    book.undo(node);
  }

  /** The next mark by its number, or the next dot without one from left to right. @param {number} by @param {boolean} isNamed */
  function step(by, isNamed) {
    settle();
    look();
    const list = dots.filter((dot) => (dot.label !== null) === isNamed && (!armed || dot.label !== context.chosen.mark)).sort((a, b) => (isNamed ? Number(a.label) - Number(b.label) : a.u - b.u));
    if (!list.length) return;
    const at = list.findIndex((dot) => (isNamed ? dot.label === (armed ? other : context.chosen.mark) : dot.u === spot?.u && dot.v === spot.v));
    const next = list[at < 0 ? (by > 0 ? 0 : list.length - 1) : (at + by + list.length) % list.length];
    if (armed) other = next.label;
    else {
      choose(next.label);
      if (!isNamed) spot = { u: next.u, v: next.v };
    }
    zoom.reach(next.u, next.v);
    tell();
  }

  /** @param {[number, number]} by */
  function nudge([x, y]) {
    look();
    const dot = chosen();
    if (spot) spot = { u: spot.u + x, v: spot.v + y };
    else if (dot && !armed) {
      pause();
      held.hold();
      moving = row(Number(dot.label), dot.u + x, dot.v + y);
      clearTimeout(rest);
      rest = setTimeout(settle, REST_MS);
    } else return false;
    const at = moving ?? spot;
    zoom.reach(Number(at?.u), Number(at?.v));
    return true;
  }

  /** The line, and which tools can do anything. */
  function tell() {
    touch();
    look();
    const mark = chosen();
    const lines = [];
    if (armed) lines.push(`${armed === "merge" ? `Click the mark that ${mark?.label} is merged into` : `Click the mark to swap ${mark?.label} with`}; j k and Enter do it by keys, Esc gives up.`);
    else if (isRunning() && held.isHeld) lines.push(`The picture stays for you, while the run goes on; ${spot ? "n gives this place a number, " : ""}Esc lets it go on.`);
    else if (isRunning() && rig.can.pause) lines.push("Pause first (space); taking a mark by hand pauses too.");
    else if (isRunning()) lines.push("This run cannot be paused: what you say counts from the picture in which you began.");
    else if (spot) lines.push("n gives this place a number; Esc leaves it.");
    else if (mark) lines.push(`Mark ${mark.label}: drag it, arrows move it by ${NUDGE_PX} px; ? lists all keys.`);
    else lines.push("Click a mark to choose it, a dot without a number to name it; ? lists all keys.");
    note.write(lines.join(" "));
    acts.name.disabled = !spot;
    for (const it of [acts.rename, acts.merge, acts.swap, acts.end]) it.disabled = !mark;
    acts.merge.setAttribute("aria-pressed", String(armed === "merge"));
    acts.swap.setAttribute("aria-pressed", String(armed === "swap"));
  }

  /** Gives up the last thing begun. */
  function giveUp() {
    if (moving) {
      moving = null;
      clearTimeout(rest);
      release();
    } else if (armed) disarm();
    else if (spot || context.chosen.mark !== null) choose(null);
    else return false;
    tell();
    return true;
  }

  /** @type {Record<string, () => unknown>} */
  const keys = {
    ...stage.keys,
    n: name,
    r: rename,
    m: () => arm("merge"),
    s: () => arm("swap"),
    z: undo,
    Delete: end,
    j: () => step(1, true),
    k: () => step(-1, true),
    u: () => !armed && step(1, false),
    Enter: () => armed && other !== null && both(other),
  };

  return {
    note: note.element,
    stage,
    lens: make("div", {}, lens, lensWords),
    tools: make("span", { class: "tools" }, ...Object.values(acts)),
    tell,
    settle,
    /** @param {import("./main.js").State} state */
    state(state) {
      if (held.phase(state.phase)) tell();
    },
    frame: held.frame,
    draw() {
      if (!dirty) return;
      dirty = false;
      look();
      const mark = chosen();
      stage.clear();
      if (picture.paint()) stage.lay(picture.canvas, picture.place(), picture.pixel());
      stage.border();
      drawMarks(context, pen, zoom.onto, stage.unit(), { dots, chosen: mark, other: dots.find((dot) => other !== null && dot.label === other) ?? null, spot });
      stage.tell();
      const at = mark ?? spot ?? pointer;
      glass.draw(picture, at, dots);
      const what = mark ? `mark ${mark.label}` : spot ? "no number" : pointer ? "pointer" : "";
      write(lensWords, `${what ? `${what}, ` : ""}picture ${frameNow() ?? "–"}\n${at ? `u ${number(at.u, 2)}  v ${number(at.v, 2)}` : ""}`);
    },
    /** @param {KeyboardEvent} event */
    key(event) {
      const by = ARROWS[event.key];
      const far = event.shiftKey ? NUDGE_FAR_PX : NUDGE_PX;
      if (by && nudge([by[0] * far, by[1] * far])) {
        touch();
        return true;
      }
      if (event.key === "Escape") return giveUp();
      const act = keys[event.key];
      if (act) act();
      return act !== undefined;
    },
  };
}
