// @ts-check
// The buttons above the room: what its keys do, for a pointer or a finger.
import { make } from "./dom.js";

/**
 * @param {{fit: () => void, along: (axis: "x" | "y" | "z") => void, parallel: () => void, through: () => void, follow: () => void, list: () => void}} acts
 * @param {{works: boolean, list: boolean}} at_first
 */
export function toolRow(acts, at_first) {
  /** @param {string} words @param {string} key @param {string} title @param {() => void} act */
  const tool = (words, key, title, act) => make("button", { type: "button", title: `${title} (${key})`, "aria-label": title, "aria-keyshortcuts": key, onclick: act }, words);
  const look = [
    tool("All", "Home", "Show all", acts.fit),
    tool("X", "x", "Look along x", () => acts.along("x")),
    tool("Y", "y", "Look along y", () => acts.along("y")),
    tool("Z", "z", "Look from above", () => acts.along("z")),
  ];
  const parallel = tool("Parallel", "o", "Parallel instead of perspective", acts.parallel);
  const through = tool("Through", "c", "Look through the chosen camera", acts.through);
  const follow = tool("Follow", "t", "Follow the chosen target", acts.follow);
  const list = tool("List", "l", "List of scales and targets", acts.list);
  list.classList.add("room-last");
  for (const button of [...look, parallel, through, follow]) button.disabled = !at_first.works;
  list.setAttribute("aria-expanded", String(at_first.list));
  return {
    element: make("div", { class: "room-tools", role: "toolbar", "aria-label": "View of the room" }, ...look, parallel, through, follow, list),
    /** @param {{parallel: boolean, through: boolean, follow: boolean, list: boolean}} now */
    write(now) {
      parallel.setAttribute("aria-pressed", String(now.parallel));
      through.setAttribute("aria-pressed", String(now.through));
      follow.setAttribute("aria-pressed", String(now.follow));
      list.setAttribute("aria-expanded", String(now.list));
    },
  };
}
