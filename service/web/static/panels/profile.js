// Depth along a line drawn on the map, with its deviation, and of a single frame for comparison.

import { useEffect, useMemo } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { want } from "../link.js";
import { images, line, useStore } from "../store.js";
import { axis, Chart, colour } from "./chart.js";
import { Panel } from "./panel.js";
import { theme } from "./theme.js";

export function ProfilePanel() {
  const drawn = useStore(line), mode = useStore(theme);
  const depth = useStore(images["fused/depth"]), deviation = useStore(images["fused/deviation"]);
  const frame = useStore(images["camera/depth"]);
  const shown = drawn && !drawn.open && depth;
  useEffect(() => (shown ? want(["camera/depth"]) : undefined), [Boolean(shown)]);
  const data = useMemo(() => (shown ? profile(drawn, depth, deviation, frame) : null), [drawn, depth, deviation, frame]);
  const clear = drawn && html`<button type="button" class="tool" onClick=${() => line.set(null)}>Clear</button>`;
  return html`<${Panel} name="profile" title="Profile" tools=${clear}>
    ${data ? html`<${Chart} make=${options} data=${data} label=${describe(data)} theme=${mode} />`
      : html`<p class="empty still">Draw a line on the map to see the depth along it.</p>`}
  </${Panel}>`;
}

/** Columns: place along the line in pixels, depth of the map, of one frame, and the map's bounds. */
function profile({ from, to }, depth, deviation, frame) {
  const length = Math.max(1, Math.round(Math.hypot(to.x - from.x, to.y - from.y)));
  const columns = [[], [], [], [], []];
  const known = (value) => (Number.isFinite(value) ? value : null);
  for (let i = 0; i <= length; i++) {
    const x = Math.round(from.x + ((to.x - from.x) * i) / length);
    const y = Math.round(from.y + ((to.y - from.y) * i) / length);
    const z = depth.at(x, y), spread = deviation?.width === depth.width ? deviation.at(x, y) : NaN;
    const single = frame
      ? frame.at(Math.floor((x * frame.width) / depth.width), Math.floor((y * frame.height) / depth.height)) : NaN;
    [i, known(z), known(single), known(z - spread), known(z + spread)].forEach((value, n) => columns[n].push(value));
  }
  return columns;
}

function describe([, depths]) {
  const known = depths.filter((z) => z !== null);
  if (known.length === 0) return "Profile: nothing is known along the line.";
  const extreme = [Math.min(...known), Math.max(...known)].map((z) => z.toFixed(3));
  return `Profile over ${depths.length} pixels: depth from ${extreme[0]} to ${extreme[1]} m.`;
}

function options() {
  const accent = colour("accent"), quiet = colour("muted");
  const bound = { stroke: "transparent", points: { show: false } };
  return {
    legend: { show: false }, cursor: { y: false, points: { size: 6 } }, padding: [8, 20, 0, 0],
    scales: { x: { time: false } },
    series: [
      {}, { stroke: accent, width: 1.6, points: { show: false } },
      { stroke: quiet, width: 1, dash: [2, 3], points: { show: false } }, bound, bound,
    ],
    bands: [{ series: [4, 3], fill: `color-mix(in srgb, ${accent} 22%, transparent)` }],
    axes: [
      axis({ size: 25, values: (_, ticks) => ticks.map((t) => `${t} px`) }),
      axis({ size: 46, values: (_, ticks) => ticks.map((t) => `${t} m`) }),
    ],
  };
}
