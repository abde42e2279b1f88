// @ts-check
// How the cameras share the window: those whose pictures have one shape stand together, so that no row has holes; and how much of their pictures is requested.

export const GAP_PX = 6;
const NARROW_PX = 600;
const LEAST_TILE_PX = 150;
const LEAST_WIDTH_PX = 160;
const MOST_HZ = 10;
const LEAST_HZ = 5;
/** Bytes of pictures a second: all cameras share one link, and the program has its own work to do. */
const MOST_BYTES = 8e6;

/** @typedef {{shape: number, n: number}} Group `shape`: height over width. */
/** @typedef {{columns: number, tile: number}} Plan */

/** Places of a list in groups of one shape, in the order in which shapes appear. @param {number[]} shapes @returns {number[][]} */
export function byShape(shapes) {
  /** @type {Map<string, number[]>} */
  const groups = new Map();
  shapes.forEach((shape, index) => {
    const key = shape.toFixed(3);
    groups.set(key, [...(groups.get(key) ?? []), index]);
  });
  return [...groups.values()];
}

/** @param {Group[]} groups @param {number} width @param {number} height @param {number} caption */
function rolling(groups, width, height, caption) {
  return groups.map(({ n }) => {
    const columns = width < NARROW_PX ? Math.min(2, n) : Math.min(n, Math.max(1, Math.floor(width / (LEAST_TILE_PX + GAP_PX))));
    return { columns, tile: Math.floor((width - GAP_PX * (columns - 1)) / columns) };
  });
}

/**
 * Columns and width of tiles of each group so that all fit without scrolling and are as large as they can be.
 * @param {Group[]} groups @param {number} width @param {number} height @param {number} caption height of a tile's caption
 * @returns {Plan[]}
 */
export function arrange(groups, width, height, caption) {
  if (width < NARROW_PX) return rolling(groups, width, height, caption);
  const across = (/** @type {number} */ columns) => (width - GAP_PX * (columns - 1)) / columns;
  /** @type {{score: number, plans: Plan[]}} */
  let best = { score: -Infinity, plans: [] };
  /** One group after the other, with each number of columns. @param {number} at @param {number[]} columns */
  function attempt(at, columns) {
    if (at < groups.length) {
      for (let n = 1; n <= groups[at].n; n++) {
        // Fewer columns with as many rows are the same, only larger.
        if (n > 1 && n < groups[at].n && Math.ceil(groups[at].n / n) === Math.ceil(groups[at].n / (n - 1))) continue;
        attempt(at + 1, [...columns, n]);
      }
      return;
    }
    const rows = columns.map((n, index) => Math.ceil(groups[index].n / n));
    const fixed = rows.reduce((sum, n) => sum + n, 0) * (caption + GAP_PX) - GAP_PX;
    const tall = rows.reduce((sum, n, index) => sum + n * across(columns[index]) * groups[index].shape, 0);
    const shrink = Math.min(1, (height - fixed) / tall);
    const tiles = columns.map((n) => Math.floor(across(n) * shrink));
    if (tiles.some((tile) => tile < LEAST_TILE_PX)) return;
    // Each camera counts, so that no group is large at the cost of another.
    const score = groups.reduce((sum, { n, shape }, index) => sum + n * Math.log(tiles[index] ** 2 * shape), 0);
    if (score > best.score) best = { score, plans: tiles.map((tile, index) => ({ columns: columns[index], tile })) };
  }
  attempt(0, []);
  return best.plans.length ? best.plans : rolling(groups, width, height, caption);
}

/**
 * How wide and how often pictures are requested: less often first, then narrower. The program reduces them by whole factors, so that only these widths differ.
 * @param {{size: [number, number], shown: number, layers: number}[]} cameras `shown`: width on the screen; `layers`: pictures of this camera, its silhouettes too
 * @returns {{widths: number[], hz: number}}
 */
export function budget(cameras) {
  const factors = cameras.map(({ size, shown }) => Math.max(1, Math.floor(size[0] / Math.max(1, shown))));
  const wide = (/** @type {number} */ index) => Math.ceil(cameras[index].size[0] / factors[index]);
  const bytes = () => cameras.reduce((sum, { size, layers }, index) => sum + layers * Math.floor(size[0] / factors[index]) * Math.floor(size[1] / factors[index]), 0);
  while (bytes() * LEAST_HZ > MOST_BYTES) {
    const widest = Math.max(...factors.map((_, index) => wide(index)));
    if (widest <= LEAST_WIDTH_PX) break;
    factors.forEach((factor, index) => (factors[index] = wide(index) === widest ? factor + 1 : factor));
  }
  const hz = Math.min(MOST_HZ, Math.max(LEAST_HZ, Math.floor(MOST_BYTES / Math.max(1, bytes()))));
  return { widths: cameras.map((_, index) => wide(index)), hz };
}
