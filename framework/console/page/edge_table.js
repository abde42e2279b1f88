// @ts-check
// The table of edges: a row for each group with its worst edge, which opens to all of them.
import { make, ms, number, write } from "./dom.js";
import { AT, groups, requirement, worst } from "./ledger.js";

const COLUMNS = /** @type {const} */ ([
  ["rate", "/s", "Deliveries a second; of several edges the lowest"],
  ["p50", "ms", "Age at delivery, median"],
  ["p99", "ms", "Age at delivery: 99 of 100 are younger"],
  ["max", "ms", "Greatest age at delivery"],
  ["gaps", "", "Messages that were never made"],
  ["drops", "", "Messages that their reader had no time for"],
  ["late", "", "Messages that came too late to be used"],
  ["count", "", "Things in the last message"],
]);

/** @param {import("./link.js").EdgeState|null} row */
function texts(row) {
  if (!row) return COLUMNS.map(() => "–");
  return [number(row[AT.rate]), ms(row[AT.p50]), ms(row[AT.p99]), ms(row[AT.max]), ...[AT.gaps, AT.dropped, AT.late, AT.count].map((column) => number(row[column], 0))];
}

/** @param {import("./main.js").Context} context @param {(node: number) => void} choose */
export function edgeTable(context, choose) {
  const { hello } = context;
  const head = make("tr", {}, make("th", { scope: "col" }, "edge"), ...COLUMNS.map(([name, unit, says]) => make("th", { scope: "col", title: says }, unit ? `${name} ${unit}` : name)), make("th", { scope: "col" }, "required"));

  /** @param {HTMLElement} name @param {import("./link.js").Requirement|null} require @param {string} kind */
  function line(name, require, kind) {
    const cells = COLUMNS.map(() => make("td"));
    const promise = make("td", { class: "promise" });
    const required = requirement(require);
    const element = make("tr", { class: kind }, make("th", { scope: "row" }, name), ...cells, promise);
    return {
      element,
      /** @param {import("./link.js").EdgeState|null} row @param {number} unmet how many of the edges that it represents */
      show(row, unmet) {
        texts(row).forEach((words, index) => {
          write(cells[index], words);
          // Gaps, drops and late ones are bad as soon as there are any.
          if (index >= 4 && index <= 6) cells[index].classList.toggle("bad", words !== "0" && words !== "–");
        });
        write(promise, required ? `${required}: ${row ? (unmet ? `✗ ${unmet > 1 ? `${unmet} ` : ""}not met` : "✓ met") : "–"}` : "");
        promise.className = unmet ? "promise bad" : "promise";
        element.classList.toggle("unmet", unmet > 0);
      },
    };
  }

  const rows = groups(hello).map((group) => {
    const isOne = group.edges.length === 1;
    const open = isOne ? null : make("button", { type: "button", class: "quiet open", "aria-expanded": "false", "aria-label": `All ${group.edges.length} edges of ${group.name}` }, "▸");
    const to = make("button", { type: "button", class: "link", title: `${group.name}${group.feedback ? " (feedback)" : ""}`, onclick: () => choose(group.to) }, group.name);
    const name = make("span", { class: "edge-name" }, open ?? make("span"), make("span", {}, to, make("span", { class: "dim" }, `${isOne ? "" : ` worst of ${group.edges.length}`}${group.feedback ? " ↺ feedback" : ""}`)));
    const edges = group.edges.map((id) => ({ id, line: line(make("span", {}, cameraOf(id)), hello.edges[id].require, "one") }));
    const first = line(name, hello.edges[group.edges[0]].require, "group");
    const body = make("tbody", {}, first.element);
    let isOpen = false;
    open?.addEventListener("click", () => {
      isOpen = !isOpen;
      open.setAttribute("aria-expanded", String(isOpen));
      write(open, isOpen ? "▾" : "▸");
      body.replaceChildren(first.element, ...(isOpen ? edges.map((it) => it.line.element) : []));
      if (context.state) show(context.state);
    });

    /** @param {import("./link.js").State} state */
    function show(state) {
      const unmet = group.edges.filter((id) => state.edges[id]?.[AT.unmet]).length;
      first.show(worst(state, group.edges), unmet);
      if (isOpen) for (const { id, line } of edges) line.show(state.edges[id] ?? null, state.edges[id]?.[AT.unmet] ? 1 : 0);
    }
    return { body, group, show };
  });

  /** What tells an edge from the others of its group. @param {number} id */
  function cameraOf(id) {
    const { from, to } = hello.edges[id];
    const camera = hello.instances[from[0]].camera ?? hello.instances[to[0]].camera;
    return camera === null ? hello.edges[id].name : hello.cameras[camera].name;
  }

  const table = make("table", { class: "edges" }, make("thead", {}, head), ...rows.map((row) => row.body));
  return {
    element: make("div", { class: "edges-place" }, table),
    /** @param {import("./link.js").State} state */
    show(state) {
      for (const row of rows) row.show(state);
    },
    /** Marks the edges of a node. @param {number|null} node */
    mark(node) {
      for (const { body, group } of rows) body.classList.toggle("near", node !== null && (group.from === node || group.to === node));
    },
  };
}
