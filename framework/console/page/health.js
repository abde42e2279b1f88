// @ts-check
// How the rig does: its nodes, what its edges measure, what has failed, and a node's settings and messages.
import { clock, make, write } from "./dom.js";
import { edgeTable } from "./edge_table.js";
import { health } from "./ledger.js";
import { nodePanel } from "./node_panel.js";
import { saveBar } from "./settings.js";

const SIGNS = { ok: "✓", warn: "△", fault: "✗", unknown: "·" };
const CLASSES = { ok: "good", warn: "warn", fault: "bad", unknown: "dim" };
const MOST_FAULTS = 50;

/** @type {import("./main.js").ViewModule} */
export const view = {
  id: "health",
  title: "Health",
  key: "3",
  create(context) {
    const { hello } = context;
    /** @type {ReturnType<typeof nodePanel>|null} */
    let panel = null;
    let chosen = -1;
    const save = saveBar(context);
    const place = make("div", {}, make("p", { class: "dim" }, "Choose a node to see its settings and messages."));

    const order = hello.scales.flatMap((_, scale) => hello.nodes.map((_, id) => id).filter((id) => hello.nodes[id].scale === scale));
    const items = new Map(order.map((id) => [id, item(id)]));
    const list = make("div", { class: "nodes", role: "listbox", "aria-label": "Nodes" });
    hello.scales.forEach(({ name, anchor }, scale) => {
      const ids = order.filter((id) => hello.nodes[id].scale === scale);
      if (!ids.length) return;
      list.append(make("div", { role: "group", "aria-label": `Scale ${name}` }, make("h3", {}, `scale ${name}`, anchor ? make("span", { class: "dim" }, ` at ${anchor}`) : null), ...ids.map((id) => /** @type {any} */ (items.get(id)).element)));
    });
    const edges = edgeTable(context, pick);
    const budgets = make("ul", { class: "plain" }, ...hello.budgets.map(({ from, to, age_ms }) => make("li", {}, `${from} → ${to}: ${age_ms} ms at most`)));
    const faults = make("ul", { class: "plain" });
    const aside = make("aside", { class: "panel", "aria-label": "Node" }, save.element, place);
    const element = make(
      "div",
      { class: "health" },
      make("section", { class: "health-nodes", "aria-label": "Nodes" }, list),
      make("section", { class: "health-edges", "aria-label": "Edges and faults" }, make("h2", {}, "Faults"), faults, make("h2", {}, "Edges"), edges.element, ...(hello.budgets.length ? [make("h2", {}, "Budgets"), budgets] : [])),
      aside,
    );

    /** @param {number} id */
    function item(id) {
      const { name, role } = hello.nodes[id];
      const sign = make("span", { class: "node-sign" });
      const element = make("div", { class: "node-item", role: "option", tabindex: -1, "aria-selected": "false", "data-node": name, onclick: () => pick(id) }, make("b", {}, name), make("span", { class: "dim" }, role), sign);
      return {
        element,
        /** @param {import("./main.js").State|null} state */
        show(state) {
          const { level, words } = health(hello, state, id);
          write(sign, `${SIGNS[level]} ${words}`);
          sign.className = `node-sign ${CLASSES[level]}`;
          element.dataset.level = level;
        },
      };
    }

    /** A click: on a narrow window the node's panel is below the list, and is brought into view. @param {number} id */
    function pick(id) {
      choose(id, true);
      if (getComputedStyle(element).display === "flex") aside.scrollIntoView();
    }

    /** @param {number} id @param {boolean} focus */
    function choose(id, focus) {
      for (const [other, it] of items) {
        it.element.setAttribute("aria-selected", String(other === id));
        it.element.tabIndex = other === id ? 0 : -1;
      }
      const it = items.get(id);
      if (focus) it?.element.focus();
      it?.element.scrollIntoView({ block: "nearest" });
      if (chosen === id) return;
      chosen = id;
      panel = nodePanel(context, id);
      place.replaceChildren(panel.element);
      edges.mark(id);
      context.changed();
    }
    const first = items.get(order[0]);
    if (first) first.element.tabIndex = 0;

    /** @param {import("./main.js").State} state */
    function showFaults({ faults: all, n_faults }) {
      const newest = all.slice(-MOST_FAULTS).reverse();
      const lines = newest.map(({ who, what, at_s }) => `${clock(at_s, 2)}  ${who}: ${what}`);
      if (!lines.length) lines.push("None so far.");
      if (n_faults > newest.length) lines.push(`… and ${n_faults - newest.length} earlier ones`);
      while (faults.children.length < lines.length) faults.append(make("li"));
      while (faults.children.length > lines.length) faults.lastChild?.remove();
      lines.forEach((words, index) => write(faults.children[index], words));
      faults.classList.toggle("bad", newest.length > 0);
    }

    return {
      element,
      wants: () => panel?.wants() ?? [],
      frame: (frame) => panel?.frame(frame),
      state(state) {
        for (const it of items.values()) it.show(state);
        edges.show(state);
        showFaults(state);
        save.state(state);
      },
      settings: (node, values) => panel?.settings(node, values),
      draw() {},
      show() {},
      hide() {},
      help: [
        ["↑ ↓", "choose a node"],
        ["Enter", "to its settings"],
      ],
      key(event) {
        const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
        if (by) {
          const at = order.indexOf(chosen);
          const next = at < 0 ? 0 : Math.min(Math.max(at + by, 0), order.length - 1);
          choose(order[next], true);
          return order.length > 0;
        }
        if (event.key !== "Enter" || chosen < 0) return false;
        const first = place.querySelector(".setting input:not(:disabled), .setting select:not(:disabled)") ?? place.querySelector("select, summary");
        /** @type {HTMLElement|null} */ (first)?.focus();
        return true;
      },
    };
  },
};
