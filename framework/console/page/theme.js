// @ts-check
// Dark or light: as the system says until the switch is used, which is remembered.
import { make, write } from "./dom.js";

const KEPT_AS = "foveate-console-theme";

function kept() {
  try {
    const name = localStorage.getItem(KEPT_AS);
    return name === "dark" || name === "light" ? name : null;
  } catch {
    return null;
  }
}

/** @param {() => void} changed */
export function theme(changed) {
  const system = matchMedia("(prefers-color-scheme: light)");
  /** @type {"dark"|"light"} */
  let now = "dark";
  const button = make("button", { type: "button", class: "quiet", onclick: () => set(now === "dark" ? "light" : "dark", true) });

  /** @param {"dark"|"light"} name @param {boolean} keep */
  function set(name, keep) {
    now = name;
    document.documentElement.dataset.theme = name;
    write(button, name === "dark" ? "Light" : "Dark");
    button.setAttribute("aria-label", `Change to the ${name === "dark" ? "light" : "dark"} theme`);
    if (keep) {
      try {
        localStorage.setItem(KEPT_AS, name);
      } catch {
        // The choice then holds until the page is closed.
      }
    }
    changed();
  }

  const follow = () => set(kept() ?? (system.matches ? "light" : "dark"), false);
  system.addEventListener("change", follow);
  follow();
  return {
    button,
    get now() {
      return now;
    },
  };
}
