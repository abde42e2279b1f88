// @ts-check
// How the room and its side list are laid out. The colours are set on the element from the palette.

export const STYLE = `
.room { display: flex; flex: 1; min-width: 0; min-height: 0; color: var(--text); background: var(--r-ground); font-variant-numeric: tabular-nums; }
.room-main { display: flex; flex-direction: column; flex: 1; min-width: 0; min-height: 0; }
.room-tools { display: flex; flex-wrap: wrap; gap: 4px; padding: 4px 6px; align-items: center; border-bottom: 1px solid var(--line); }
.room button { font: inherit; font-size: 13px; color: inherit; background: transparent; border: 1px solid var(--line); border-radius: 4px; padding: 2px 8px; min-height: 26px; cursor: pointer; }
.room button:hover { border-color: var(--dim); }
.room button[aria-pressed="true"], .room button[aria-expanded="true"] { background: var(--raised); border-color: var(--dim); }
.room button:disabled { opacity: 0.45; cursor: default; }
.room-tools .room-last { margin-left: auto; }
.room-stage { position: relative; flex: 1; min-height: 0; min-width: 0; overflow: hidden; }
.room-stage canvas { position: absolute; inset: 0; width: 100%; height: 100%; display: block; touch-action: none; }
.room-stage canvas:focus-visible { outline: 2px solid var(--accent); outline-offset: -2px; }
.room-stage canvas.room-names { pointer-events: none; }
.room-stage .room-absent { position: absolute; inset: 0; display: grid; place-content: center; padding: 24px; text-align: center; margin: 0; background: var(--r-ground); }
.room-stage .room-absent[hidden], .room-side[hidden] { display: none; }
.room-side { width: 340px; flex: none; overflow-y: auto; border-left: 1px solid var(--line); padding: 6px 10px 12px; font-size: 13px; line-height: 1.35; scrollbar-gutter: stable; }
.room-side h3 { font-size: 13px; margin: 12px 0 2px; display: flex; gap: 8px; align-items: baseline; }
.room-side h3 span { font-weight: normal; color: var(--dim); margin-left: auto; text-align: right; }
.room-side details { border-bottom: 1px solid var(--line); padding: 4px 0; }
.room-side summary { cursor: pointer; font-weight: 600; }
.room-checks { display: grid; grid-template-columns: 1fr 1fr; gap: 0 8px; padding: 2px 0 4px; }
.room-streams label { display: flex; gap: 6px; align-items: center; min-height: 24px; overflow-wrap: anywhere; }
.room-checks label { display: flex; gap: 6px; align-items: center; min-height: 24px; }
.room-key { display: flex; flex-wrap: wrap; gap: 0 12px; color: var(--dim); }
.room-key i { font-style: normal; margin-right: 4px; }
.room-head, .room-side button.room-row { display: grid; grid-template-columns: 12px minmax(34px, 1fr) repeat(3, 50px) 36px 34px; gap: 4px; align-items: baseline; width: 100%; text-align: right; padding: 1px 2px; font-size: 12px; }
.room-head { color: var(--dim); }
.room-side button.room-row { border-color: transparent; min-height: 22px; white-space: nowrap; }
.room-side button.room-row:hover { border-color: var(--line); }
.room-side button.room-row[aria-pressed="true"] { border-color: var(--dim); }
.room-side button.room-camera { grid-template-columns: 14px minmax(0, 1fr) auto; text-align: left; }
.room-row span:nth-child(2), .room-head span:nth-child(2) { text-align: left; overflow: hidden; text-overflow: ellipsis; }
.room-counts { margin: 2px 4px; color: var(--dim); }
.room [data-is="Measured"] { color: var(--r-Measured); }
.room [data-is="Predicted"] { color: var(--r-Predicted); }
.room [data-is="Filled"] { color: var(--r-Filled); }
.room [data-is="mark"] { color: var(--r-mark); }
.room [data-is="head"] { color: var(--r-head); }
@media (max-width: 760px) {
  .room { flex-direction: column; }
  .room-side { width: auto; flex: none; height: 38%; border-left: none; border-top: 1px solid var(--line); }
  .room button { padding: 2px 7px; }
  .room kbd { display: none; }
}
@media (max-width: 760px) and (max-height: 500px) { .room-side { height: 45%; } }
`;
