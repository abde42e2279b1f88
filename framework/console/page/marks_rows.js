// @ts-check
// The rows of a correction by hand: what the program has of them, what was sent and is on its way, and how to take them back.

/** @typedef {{camera: number, mark: number, frame: number, u: number|null, v: number|null, node?: number, remove?: boolean}} Row From this picture on the mark is there; `u`, `v` null: it is not visible. */
/** @typedef {{kind: "swap"|"gap", camera: number, mark: number, other: number|null, frame: number, at_s: number, frames?: number, until_s?: number, reason: string}} Problem */
/** @typedef {{node: number, file: string, again: {state: "idle"|"running"|"done"|"failed", words: string}, rows: Row[], problems: Problem[], searching: boolean}} Marks */
/** @typedef {{label: number|null, u: number, v: number, byHand: boolean}} Dot */

/** A feature so near to where a mark was put is that mark. */
const SAME_PX = 3;

const same = (/** @type {Row} */ a, /** @type {Row} */ b) => a.node === b.node && a.camera === b.camera && a.mark === b.mark && a.frame === b.frame;

/** The program may keep fewer digits. @param {number|null} a @param {number|null} b */
const isNear = (a, b) => a === b || (a !== null && b !== null && Math.abs(a - b) < 0.01);

/**
 * What is seen in a picture: what the tracker found, and in its place what a hand said of this very picture.
 * @param {import("./overlay.js").Feature[]} features @param {Row[]} rows of this camera and picture @returns {Dot[]}
 */
export function applied(features, rows) {
  /** @type {Dot[]} */
  let dots = features.map(({ centre, label }) => ({ label: label ?? null, u: centre[0], v: centre[1], byHand: false }));
  const said = new Set(rows.map((row) => row.mark));
  dots = dots.map((dot) => (dot.label !== null && said.has(dot.label) ? { ...dot, label: null } : dot));
  for (const { mark, u, v } of rows) {
    if (u === null || v === null) continue;
    const near = (/** @type {Dot} */ dot) => dot.label === null && Math.hypot(dot.u - u, dot.v - v) < SAME_PX;
    dots = [...dots.filter((dot) => !near(dot)), { label: mark, u, v, byHand: true }];
  }
  return dots;
}

/** The least number that no mark of this picture has; first one that other cameras know. @param {Dot[]} dots @param {Iterable<number>} known */
export function freeNumber(dots, known) {
  const used = new Set(dots.map((dot) => dot.label));
  const all = [...known].sort((a, b) => a - b);
  const lacking = all.find((label) => !used.has(label));
  if (lacking !== undefined) return lacking;
  return Math.max(0, ...all, ...[...used].map((label) => label ?? 0)) + 1;
}

/** @param {import("./main.js").Context} context @param {() => void} changed */
export function rowBook(context, changed) {
  /** @type {Marks|null} */
  let sheet = null;
  /** @type {Row[]} Sent, and not in a sheet yet. */
  let underway = [];
  /** @type {{rows: Row[], before: (Row|undefined)[]}[]} */
  const done = [];

  function rows() {
    const kept = (sheet?.rows ?? []).filter((row) => !underway.some((it) => same(it, row)));
    return [...kept, ...underway.filter((row) => !row.remove)];
  }

  /** @param {number} node @param {Row[]} sent */
  async function tell(node, sent) {
    underway = [...underway.filter((row) => !sent.some((it) => same(it, row))), ...sent];
    changed();
    const answer = await context.command({ do: "correct", node, rows: sent.map(({ node: _, ...row }) => row) });
    if (!answer.ok) {
      underway = underway.filter((row) => !sent.includes(row));
      context.say(`Not corrected: ${answer.words}`);
      changed();
    } else if (answer.words) context.say(answer.words);
    return answer.ok;
  }

  return {
    /** @param {Marks} now */
    take(now) {
      sheet = now;
      // An older sheet may come while a row is on its way: that one stays.
      underway = underway.filter((row) => !row.remove !== now.rows.some((it) => same(it, row) && (row.remove || (isNear(it.u, row.u) && isNear(it.v, row.v)))));
      changed();
    },
    get sheet() {
      return sheet;
    },
    rows,
    /** @param {number} node @param {Row[]} sent */
    async send(node, sent) {
      const named = sent.map((row) => ({ ...row, node }));
      const entry = { rows: named, before: named.map((row) => rows().find((it) => same(it, row))) };
      done.push(entry);
      if (!(await tell(node, named))) done.splice(done.indexOf(entry), 1);
    },
    /** Takes the last step back; of an earlier window's, the last row. @param {number} node */
    undo(node) {
      const last = done.pop();
      const [row] = rows().filter((it) => it.node === node).slice(-1);
      if (last) void tell(last.rows[0].node ?? node, last.rows.map((it, index) => last.before[index] ?? { ...it, remove: true }));
      else if (row) void tell(node, [{ ...row, remove: true }]);
      else context.say("There is no row to take back.");
    },
  };
}
