// @ts-check
// Time: pause, steps and the end of a run; of a recorded session also where, how fast, and around what. Only what the rig can is shown.
import { clock, make, write } from "./dom.js";

/** @typedef {import("./link.js").Hello} Hello */
/** @typedef {import("./link.js").State} State */

const SEEK_EVERY_MS = 60;
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

/**
 * @param {HTMLElement} bar
 * @param {{command: (words: object) => Promise<import("./link.js").Answer>, say: (words: string) => void}} shell
 */
export function timeBar(bar, shell) {
  /** @type {Hello|null} */
  let hello = null;
  /** @type {State|null} */
  let state = null;
  let from = /** @type {number|null} */ (null);
  let dragging = false;
  let seekTimer = 0;
  let seekTo = 0;
  /** @type {any} */
  let parts = {};

  /** @param {string} words @param {string} key @param {string} title @param {() => void} act */
  const button = (words, key, title, act) => make("button", { type: "button", class: "tool", title, "aria-label": title, "aria-keyshortcuts": key, onclick: act }, make("span", {}, words), make("kbd", {}, key === " " ? "space" : key));

  const isPaused = () => state?.phase === "paused";
  const toggle = () => void shell.command({ do: isPaused() ? "go" : "pause" });
  const step = () => void shell.command({ do: "step" });
  const stepBack = () => void shell.command({ do: "step", by: -1 });

  /** The newest place while the slider moves, a few times a second. @param {number} to_s */
  function seek(to_s) {
    seekTo = to_s;
    if (seekTimer) return;
    void shell.command({ do: "seek", to_s });
    const sent = to_s;
    seekTimer = setTimeout(() => {
      seekTimer = 0;
      if (seekTo !== sent) seek(seekTo);
    }, SEEK_EVERY_MS);
  }

  function loopIn() {
    if (!state) return;
    from = state.now_s;
    shell.say(`A loop begins at ${clock(from, 2)}; ] ends it.`);
    marks();
  }

  function loopOut() {
    if (!state) return;
    const start = from ?? state.span_s?.[0] ?? 0;
    if (state.now_s <= start) {
      shell.say("A loop ends after its beginning.");
      return;
    }
    from = null;
    void shell.command({ do: "loop", from_s: start, to_s: state.now_s });
  }

  function loopOff() {
    from = null;
    void shell.command({ do: "loop" });
    marks();
  }

  /** A note in place of the button: Enter sends, Escape gives up. */
  function bookmark() {
    if (!state || parts.note.isConnected) return;
    const at_s = state.now_s;
    const before = document.activeElement;
    const leave = () => {
      parts.note.replaceWith(parts.bookmark);
      if (before instanceof HTMLElement) before.focus();
    };
    const input = make("input", { type: "text", "aria-label": `Note of the bookmark at ${clock(at_s, 2)}`, placeholder: `note at ${clock(at_s, 2)}`, size: 22, maxlength: 200 });
    const send = make("button", { type: "submit", class: "tool" }, "Mark");
    parts.note.replaceChildren(input, send);
    parts.note.onsubmit = async (/** @type {Event} */ event) => {
      event.preventDefault();
      const note = input.value.trim();
      leave();
      const answer = await shell.command({ do: "bookmark", at_s, note });
      if (answer.ok && !answer.words) shell.say(`Bookmark at ${clock(at_s, 2)}.`);
    };
    parts.note.onkeydown = (/** @type {KeyboardEvent} */ event) => {
      if (event.key !== "Escape") return;
      event.stopPropagation();
      leave();
    };
    parts.bookmark.replaceWith(parts.note);
    input.focus();
  }

  /** Recording begins or ends. */
  function record() {
    void shell.command({ do: "record", on: !state?.recording });
  }

  /** Ending a run cannot be taken back: asked once more, in place. */
  function stop() {
    const leave = () => {
      sure.replaceWith(parts.stop);
      parts.stop.focus();
    };
    const no = make("button", { type: "button", class: "tool", onclick: leave }, "Go on");
    const yes = make("button", { type: "button", class: "tool danger" }, "End the run");
    yes.onclick = async () => {
      leave();
      const answer = await shell.command({ do: "stop" });
      if (answer.ok && !answer.words) shell.say("The run ends; its results are written.");
    };
    const sure = make("span", { class: "tools", role: "group", "aria-label": "End the run?" }, yes, no);
    parts.stop.replaceWith(sure);
    no.focus();
  }

  function marks() {
    if (!parts.slider || !state?.span_s) return;
    const [a, b] = state.span_s;
    const loop = state.loop ?? (from === null ? null : [from, state.now_s]);
    const part = (/** @type {number} */ t) => `${((t - a) / Math.max(b - a, 1e-9)) * 100}%`;
    parts.track.style.setProperty("--from", loop ? part(loop[0]) : "0%");
    parts.track.style.setProperty("--to", loop ? part(Math.max(loop[0], loop[1])) : "0%");
    parts.off.disabled = !state.loop && from === null;
  }

  function build() {
    if (!hello) return;
    const { can } = hello.rig;
    const isSession = hello.rig.mode === "session";
    parts = {};
    const row = [];
    if (can.pause) row.push((parts.go = button("Pause", " ", "Pause or go on", toggle)));
    if (can.step && isSession) row.push(button("Back", ",", "One picture back", stepBack));
    if (can.record) row.push((parts.record = button("Record", "R", "Record, or end the recording", record)));
    if (can.step) row.push(button("Step", ".", "One picture on", step));
    if (can.seek) {
      parts.slider = make("input", { type: "range", min: 0, max: hello.rig.duration_s ?? 1, step: 0.01, value: 0, "aria-label": "Time" });
      parts.slider.addEventListener("input", () => seek(Number(parts.slider.value)));
      parts.slider.addEventListener("pointerdown", () => (dragging = true));
      for (const end of ["pointerup", "pointercancel"]) parts.slider.addEventListener(end, () => (dragging = false));
      parts.track = make("span", { class: "track" }, parts.slider);
      row.push(parts.track);
    }
    if (can.loop) {
      parts.off = make("button", { type: "button", class: "tool", onclick: loopOff }, "No loop");
      row.push(make("span", { class: "tools" }, button("In", "[", "The loop begins here", loopIn), button("Out", "]", "The loop ends here", loopOut), parts.off));
    }
    if (can.speed) {
      const choices = SPEEDS.map((factor) => make("option", { value: factor, selected: factor === 1 }, `${factor} ×`));
      parts.speed = make("select", { "aria-label": "Speed", onchange: () => void shell.command({ do: "speed", factor: Number(parts.speed.value) }) }, ...choices);
      row.push(parts.speed);
    }
    if (can.bookmark) {
      parts.note = make("form", { class: "tools" });
      row.push((parts.bookmark = button("Bookmark", "b", "Bookmark this moment, with a note", bookmark)));
    }
    if (can.stop) row.push((parts.stop = make("button", { type: "button", class: "tool", onclick: stop }, "End the run …")));
    bar.replaceChildren(...row);
    bar.hidden = row.length === 0;
  }

  return {
    /** @param {Hello} greeting */
    hello(greeting) {
      hello = greeting;
      state = null;
      from = null;
      build();
    },
    /** @param {State} now */
    state(now) {
      state = now;
      const ended = now.phase === "finished";
      if (parts.record) write(parts.record.firstChild, now.recording ? "● End recording" : "Record");
      if (parts.go) write(parts.go.firstChild, isPaused() ? "Go" : "Pause");
      if (!parts.slider) for (const button of bar.querySelectorAll("button")) button.disabled = ended && button !== parts.bookmark;
      if (parts.slider && now.span_s) {
        parts.slider.min = now.span_s[0];
        parts.slider.max = now.span_s[1];
        if (!dragging) parts.slider.value = now.now_s;
        parts.slider.setAttribute("aria-valuetext", clock(now.now_s, 2));
        marks();
      }
    },
    /** @returns {[string, string][]} */
    help() {
      const can = hello?.rig.can;
      /** @type {[boolean|undefined, string, string][]} */
      const all = [
        [can?.pause, "space", "pause, go on"],
        [can?.step, ".", "one picture on"],
        [can?.step && can.seek, ",", "one picture back"],
        [can?.loop, "[ ]", "the loop begins, ends here"],
        [can?.record, "R", "record, or end the recording"],
        [can?.bookmark, "b", "bookmark this moment, with a note"],
      ];
      return all.filter(([has]) => has).map(([, key, what]) => [key, what]);
    },
    /** @param {KeyboardEvent} event */
    key(event) {
      if (!hello) return false;
      const can = hello.rig.can;
      const acts = /** @type {Record<string, [boolean, () => void]>} */ ({
        " ": [can.pause, toggle],
        ".": [can.step, step],
        ",": [can.step && can.seek, stepBack],
        "[": [can.loop, loopIn],
        "]": [can.loop, loopOut],
        R: [can.record, record],
        b: [can.bookmark, bookmark],
      });
      const [has, act] = acts[event.key] ?? [false, () => {}];
      if (has) act();
      return has;
    },
  };
}
