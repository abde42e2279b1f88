// @ts-check
// What belongs to a camera: its topics, its edges and the nodes that serve it.

/** @typedef {import("./link.js").Hello} Hello */
/** @typedef {import("./link.js").State} State */

/**
 * @typedef {object} Served
 * @property {number} index
 * @property {string} name
 * @property {[number, number]} size
 * @property {number|null} image Topic of its pictures.
 * @property {number[]} features Topics of what was found in them.
 * @property {number|null} silhouette
 * @property {number|null} source Node that its pictures come from.
 * @property {number[]} detectors Nodes that search them; the one with masks first.
 * @property {number[]} edges Edges that carry its pictures.
 */

/** @param {Hello} hello @param {number} node @param {string} name */
export function setting(hello, node, name) {
  return hello.nodes[node].settings.find((it) => it.name === name) ?? null;
}

/** @param {Hello} hello @returns {Served[]} */
export function servedCameras(hello) {
  const nodeOf = (/** @type {number} */ topic) => hello.instances[hello.topics[topic].instance].node;
  return hello.cameras.map(({ name, size }, index) => {
    const topics = hello.topics.map((_, id) => id).filter((id) => hello.topics[id].camera === index);
    const of = (/** @type {string} */ message) => topics.filter((id) => hello.topics[id].message === message);
    const images = of("image");
    const image = images.find((id) => hello.nodes[nodeOf(id)].role === "source") ?? images[0] ?? null;
    const nodes = [...new Set(hello.instances.filter((it) => it.camera === index).map((it) => it.node))];
    const detectors = nodes.filter((node) => hello.nodes[node].role === "detector");
    const hasMasks = (/** @type {number} */ node) => (setting(hello, node, "masks") ? 0 : 1);
    return {
      index,
      name,
      size,
      image,
      features: of("features"),
      silhouette: of("silhouette")[0] ?? null,
      source: image === null ? null : nodeOf(image),
      detectors: detectors.sort((a, b) => hasMasks(a) - hasMasks(b)),
      edges: hello.edges.map((_, id) => id).filter((id) => hello.edges[id].topic === image),
    };
  });
}

/** The polygons that a camera's detectors do not search. @param {Hello} hello @param {Served} camera @returns {[number, number][][]} */
export function masksOf(hello, camera) {
  return camera.detectors.flatMap((node) => [...(setting(hello, node, "masks")?.value ?? []), ...(setting(hello, node, "camera_masks")?.value?.[camera.name] ?? [])]);
}

/**
 * How a camera's pictures arrive: the best rate, the worst of the rest.
 * @param {State|null} state @param {Served} camera
 */
export function traffic(state, camera) {
  const edges = camera.edges.map((id) => state?.edges[id]).filter((it) => it !== undefined);
  const most = (/** @type {number} */ column) => {
    const known = edges.map((edge) => edge[column]).filter((value) => typeof value === "number");
    return known.length ? Math.max(.../** @type {number[]} */ (known)) : null;
  };
  return { rate: most(1), gaps: most(4), drops: most(5), age: most(7) };
}
