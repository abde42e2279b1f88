// @ts-check
// Which part of a picture a canvas shows: wheel, pinch and keys zoom, dragging pans.

const LARGEST = 64;
const CLICK_PX = 4;
const DOUBLE_MS = 350;

/**
 * Something on the picture that can be dragged: then the picture stays where it is.
 * @typedef {object} Hold
 * @property {(u: number, v: number, event: PointerEvent) => boolean} grab Whether there is something to drag.
 * @property {(u: number, v: number) => void} drag
 * @property {() => void} drop
 * @property {() => void} letGo It was only a click, or a second finger came.
 */

/**
 * @param {HTMLCanvasElement} canvas
 * @param {[number, number]} size of what is shown
 * @param {{changed: () => void, click: (u: number, v: number, event: PointerEvent, isSecond: boolean) => void, over: (u: number, v: number) => void, out: () => void, hold?: Hold}} heard
 */
export function zoomed(canvas, size, heard) {
  /** CSS pixels per camera pixel. */
  let scale = 1;
  let centre = [size[0] / 2 - 0.5, size[1] / 2 - 0.5];
  let isFit = true;
  /** @type {Map<number, [number, number]>} */
  const fingers = new Map();
  let travelled = 0;
  let isHeld = false;
  let last = { time: -Infinity, x: 0, y: 0 };

  const fitting = () => Math.min(canvas.clientWidth / size[0], canvas.clientHeight / size[1]) || 1;
  const least = () => Math.min(fitting(), 1) / 2;

  /** Camera pixels at a place on the canvas, in CSS pixels from its corner. @param {number} x @param {number} y @returns {[number, number]} */
  function under(x, y) {
    return [centre[0] + (x - canvas.clientWidth / 2) / scale, centre[1] + (y - canvas.clientHeight / 2) / scale];
  }

  /** Keeps the middle of the view on the picture. */
  function hold() {
    centre = centre.map((value, axis) => Math.min(Math.max(value, -0.5), size[axis] - 0.5));
    heard.changed();
  }

  /** What lies at (x, y) stays there. @param {number} to @param {number} x @param {number} y */
  function scaleTo(to, x, y) {
    const [u, v] = under(x, y);
    scale = Math.min(Math.max(to, least()), LARGEST);
    isFit = false;
    const [nowU, nowV] = under(x, y);
    centre = [centre[0] + u - nowU, centre[1] + v - nowV];
    hold();
  }

  /** @param {PointerEvent|WheelEvent} event @returns {[number, number]} */
  function placeOf(event) {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const unit = event.deltaMode === 1 ? 20 : 1;
    scaleTo(scale * Math.exp(-event.deltaY * unit * (event.ctrlKey ? 0.01 : 0.0018)), ...placeOf(event));
    heard.over(...under(...placeOf(event)));
  }, { passive: false });

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, placeOf(event));
    if (isHeld) heard.hold?.letGo();
    isHeld = false;
    if (fingers.size !== 1) return;
    travelled = 0;
    isHeld = event.button === 0 && (heard.hold?.grab(...under(...placeOf(event)), event) ?? false);
  });

  canvas.addEventListener("pointermove", (event) => {
    const at = placeOf(event);
    const before = fingers.get(event.pointerId);
    if (before && fingers.size === 1) {
      travelled += Math.hypot(at[0] - before[0], at[1] - before[1]);
      if (travelled >= CLICK_PX && isHeld) heard.hold?.drag(...under(...at));
      else if (travelled >= CLICK_PX) {
        centre = [centre[0] - (at[0] - before[0]) / scale, centre[1] - (at[1] - before[1]) / scale];
        isFit = false;
        hold();
      }
    } else if (before && fingers.size === 2) {
      const [other] = [...fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
      const [was, is] = [before, at].map((place) => Math.hypot(place[0] - other[0], place[1] - other[1]));
      travelled = CLICK_PX;
      if (was > 0) scaleTo((scale * is) / was, (at[0] + other[0]) / 2, (at[1] + other[1]) / 2);
    }
    if (before) fingers.set(event.pointerId, at);
    heard.over(...under(...at));
  });

  canvas.addEventListener("pointerup", (event) => {
    const isLast = fingers.size === 1;
    fingers.delete(event.pointerId);
    if (isHeld && travelled >= CLICK_PX) heard.hold?.drop();
    else if (isHeld) heard.hold?.letGo();
    isHeld = false;
    if (!isLast || travelled >= CLICK_PX || event.button !== 0) return;
    const [x, y] = placeOf(event);
    const isSecond = event.timeStamp - last.time < DOUBLE_MS && Math.hypot(x - last.x, y - last.y) < 2 * CLICK_PX;
    last = { time: isSecond ? -Infinity : event.timeStamp, x, y };
    heard.click(...under(x, y), event, isSecond);
  });
  canvas.addEventListener("pointercancel", (event) => {
    fingers.delete(event.pointerId);
    if (isHeld) heard.hold?.letGo();
    isHeld = false;
  });
  canvas.addEventListener("pointerleave", () => heard.out());

  return {
    get scale() {
      return scale;
    },
    get isFit() {
      return isFit;
    },
    /** From camera pixels to pixels of the canvas. @param {number} u @param {number} v @returns {[number, number]} */
    onto: (u, v) => [((u - centre[0]) * scale + canvas.clientWidth / 2) * devicePixelRatio, ((v - centre[1]) * scale + canvas.clientHeight / 2) * devicePixelRatio],
    fit() {
      scale = fitting();
      centre = [size[0] / 2 - 0.5, size[1] / 2 - 0.5];
      isFit = true;
      heard.changed();
    },
    /** @param {number} factor */
    by: (factor) => scaleTo(scale * factor, canvas.clientWidth / 2, canvas.clientHeight / 2),
    /** One pixel of the camera on one of the screen. */
    oneToOne: () => scaleTo(1 / devicePixelRatio, canvas.clientWidth / 2, canvas.clientHeight / 2),
    /** By CSS pixels. @param {number} x @param {number} y */
    pan(x, y) {
      centre = [centre[0] + x / scale, centre[1] + y / scale];
      isFit = false;
      hold();
    },
    /** Moves the view so that a point is in it. @param {number} u @param {number} v */
    reach(u, v) {
      const half = [canvas.clientWidth / 2 / scale, canvas.clientHeight / 2 / scale];
      centre = [u, v].map((value, axis) => Math.min(Math.max(centre[axis], value - half[axis]), value + half[axis]));
      hold();
    },
  };
}
