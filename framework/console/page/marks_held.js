// @ts-check
// A picture that stays while a hand is at it: what is said of marks is said of this one, whatever comes meanwhile.

/** @typedef {import("./main.js").Frame} Frame */

const KEPT = 16;
/** What comes so long after the pause was requested, by a step. */
const UNDERWAY_MS = 500;

/** @param {(frame: Frame) => void} take */
export function heldFrames(take) {
  let isHeld = false;
  /** @type {Frame[]} */
  let later = [];
  let phase = "";
  let since = -Infinity;
  return {
    get isHeld() {
      return isHeld;
    },
    hold() {
      isHeld = true;
    },
    /** Whether it was held: what came meanwhile is shown now. */
    release() {
      const was = isHeld;
      isHeld = false;
      for (const frame of later) take(frame);
      later = [];
      return was;
    },
    /** Whether the phase is another one than before. @param {string} now */
    phase(now) {
      if (now === phase) return false;
      phase = now;
      since = performance.now();
      return true;
    },
    /** @param {Frame} frame */
    frame(frame) {
      const isAsked = phase !== "running" && performance.now() - since > UNDERWAY_MS;
      if (isAsked) later = [];
      if (!isHeld || isAsked) take(frame);
      else if (later.push(frame) > KEPT) later.shift();
    },
  };
}
