// @ts-check
// What the edges of the graph measure: in groups, of which the worst is shown, and how that speaks about the nodes.

/** @typedef {import("./link.js").Hello} Hello */
/** @typedef {import("./link.js").State} State */
/** @typedef {import("./link.js").EdgeState} EdgeState */
/** @typedef {import("./link.js").Requirement} Requirement */

/** Places in an edge's row of a state. */
export const AT = /** @type {const} */ ({ delivered: 0, rate: 1, count: 2, unmet: 3, gaps: 4, dropped: 5, late: 6, p50: 7, p99: 8, max: 9 });

/** @typedef {{from: number, to: number, port: string, input: string, name: string, feedback: boolean, edges: number[]}} Group */

/** Edges between the same ports of the same nodes, once for each camera, are a group. @param {Hello} hello @returns {Group[]} */
export function groups(hello) {
  /** @type {Map<string, Group>} */
  const found = new Map();
  hello.edges.forEach((edge, id) => {
    const from = hello.instances[edge.from[0]].node;
    const to = hello.instances[edge.to[0]].node;
    const port = hello.topics[edge.topic]?.port ?? "";
    const key = `${from} ${port} ${to} ${edge.input}`;
    const group = found.get(key);
    if (group) group.edges.push(id);
    else found.set(key, { from, to, port, input: edge.input, name: `${hello.nodes[from].name}.${port} → ${hello.nodes[to].name}.${edge.input}`, feedback: edge.feedback, edges: [id] });
  });
  return [...found.values()];
}

/** The worst of several edges: the lowest rate and count, the most of everything else. @param {State} state @param {number[]} edges @returns {EdgeState|null} */
export function worst(state, edges) {
  const rows = edges.map((id) => state.edges[id]).filter((row) => row !== undefined);
  if (!rows.length) return null;
  const pick = (/** @type {number} */ column, /** @type {(...values: number[]) => number} */ best) => {
    const known = rows.map((row) => row[column]).filter((value) => typeof value === "number");
    return known.length ? best(.../** @type {number[]} */ (known)) : null;
  };
  const least = (/** @type {number} */ column) => pick(column, Math.min);
  const most = (/** @type {number} */ column) => pick(column, Math.max);
  const silent = rows.some((row) => row[AT.delivered] === 0);
  return /** @type {EdgeState} */ ([least(0), silent ? 0 : least(1), least(2), rows.some((row) => row[AT.unmet]), most(4), most(5), most(6), most(7), most(8), most(9)]);
}

/** @param {Requirement|null} require */
export function requirement(require) {
  const parts = [];
  if (require?.age_ms != null) parts.push(`age ≤ ${require.age_ms} ms`);
  if (require?.rate_hz != null) parts.push(`rate ≥ ${require.rate_hz} Hz`);
  if (require?.sigma != null) parts.push(`σ ≤ ${require.sigma}`);
  if (require?.loss != null) parts.push(`loss ≤ ${100 * require.loss} %`);
  return parts.join(", ");
}

/** Whether a fault is one of a node: its own name, or that of one of its instances. @param {string} who @param {string} node */
const isOf = (who, node) => who === node || who.startsWith(`${node}[`) || who.startsWith(`${node}.`);

/**
 * How a node does. Gaps are its producer's, drops and unmet requirements its consumer's.
 * @param {Hello} hello @param {State|null} state @param {number} node
 * @returns {{level: "ok"|"warn"|"fault"|"unknown", words: string}}
 */
export function health(hello, state, node) {
  if (!state) return { level: "unknown", words: "not known yet" };
  const { name } = hello.nodes[node];
  const faults = state.faults.filter(({ who }) => isOf(who, name));
  let gaps = 0;
  let drops = 0;
  let unmet = 0;
  /** @type {Map<number, number>} An output's gaps are seen by all its readers: counted once. */
  const missing = new Map();
  hello.edges.forEach((edge, id) => {
    const row = state.edges[id];
    if (!row) return;
    if (hello.instances[edge.from[0]].node === node) missing.set(edge.topic, Math.max(missing.get(edge.topic) ?? 0, row[AT.gaps] ?? 0));
    if (hello.instances[edge.to[0]].node !== node) return;
    drops += row[AT.dropped] ?? 0;
    if (row[AT.unmet]) unmet++;
  });
  for (const n of missing.values()) gaps += n;
  const parts = [];
  if (faults.length) parts.push(faults.length === 1 ? "fault" : `${faults.length} faults`);
  if (unmet) parts.push(`${unmet} unmet`);
  if (gaps) parts.push(`${gaps} ${gaps === 1 ? "gap" : "gaps"}`);
  if (drops) parts.push(`${drops} ${drops === 1 ? "drop" : "drops"}`);
  return { level: faults.length ? "fault" : parts.length ? "warn" : "ok", words: parts.join(", ") || "ok" };
}
