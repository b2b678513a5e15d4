// The fused map: colours, a probe, a line, and one frame beside it under a slider.

import { useEffect, useMemo, useState } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { ColourBar, PictureCanvas } from "../images/canvas.js";
import { REASONS } from "../images/picture.js";
import { pointing } from "../images/pointing.js";
import { measured } from "../format.js";
import { want } from "../link.js";
import { images, line, offered, probe, useStore } from "../store.js";
import { Choice, Figure, Panel } from "./panel.js";

/** What can be shown; what the server does not offer is left out. */
const LAYERS = [
  ["fused/depth", "Depth"], ["fused/deviation", "Deviation"], ["fused/amplitude", "Amplitude"],
  ["fused/reason", "Reason"], ["compare", "Compare"],
];
const FUSED = LAYERS.slice(0, 4).map(([topic]) => topic);

export function MapPanel() {
  const [layer, setLayer] = useState("fused/depth");
  const [drawing, setDrawing] = useState(false);
  const depth = useStore(images["fused/depth"]), place = useStore(probe);
  const picture = useStore(images[layer === "compare" ? "fused/depth" : layer]);
  useEffect(() => want(layer === "compare" ? [...FUSED, "camera/depth"] : FUSED), [layer]);
  const known = useStore(offered);
  const layers = LAYERS.filter(([topic]) => topic === "compare" || known.includes(topic));
  const value = picture && place ? valueAt(picture, place) : NaN;
  const tools = html`<${Choice} label="What the map shows" options=${layers} value=${layer} onChange=${setLayer} />
    <button type="button" class="tool" aria-pressed=${String(drawing)} title="A finger draws a line; a mouse always does"
      onClick=${() => setDrawing(!drawing)}>Line</button>`;
  return html`<${Panel} name="map" title="Map" tools=${tools}>
    <${Stage} picture=${picture} depth=${depth} drawing=${drawing} compare=${layer === "compare"} />
    <${ColourBar} picture=${picture} low=${picture?.low} high=${picture?.high} value=${value} />
    <${Readout} />
  </${Panel}>`;
}

/** Value of a picture at a place of the depth map; NaN outside. */
function valueAt(picture, { x, y }) {
  return x < picture.width && y < picture.height ? picture.at(x, y) : NaN;
}

function Stage({ picture, depth, drawing, compare }) {
  const width = depth?.width ?? 704, height = depth?.height ?? 576;
  const handlers = useMemo(() => pointing({ width, height }, drawing), [width, height, drawing]);
  const style = { aspectRatio: `${width} / ${height}` };
  return html`<div class=${`stage ${drawing ? "drawing" : ""}`} style=${style} tabindex="0" role="application"
      aria-label="Fused map. Arrow keys move the probe, with Shift by ten; Enter begins and ends a line, Escape removes it."
      ...${handlers}>
    <${PictureCanvas} picture=${picture} />
    ${compare && html`<${Comparison} depth=${depth} />`}
    ${!picture && html`<p class="empty">${depth ? "This method gives none." : "No map yet."}</p>`}
    <${Overlay} width=${width} height=${height} />
  </div>`;
}

function Comparison({ depth }) {
  const frame = useStore(images["camera/depth"]);
  const [share, setShare] = useState(50);
  return html`<div class="frame-side" style=${{ clipPath: `inset(0 ${100 - share}% 0 0)` }}>
      ${frame && html`<${PictureCanvas} picture=${frame} low=${depth?.low} high=${depth?.high} name="sharp" />`}
    </div>
    <span class="side-name left">one frame</span><span class="side-name right">map</span>
    <input class="divider" type="range" min="0" max="100" value=${share} aria-label="How much of the single frame is shown"
      onInput=${(event) => setShare(Number(event.target.value))} />`;
}

function Overlay({ width, height }) {
  const place = useStore(probe), drawn = useStore(line);
  return html`<svg class="overlay" viewBox=${`0 0 ${width} ${height}`} preserveAspectRatio="none" aria-hidden="true">
    ${drawn && html`<g class="line">${["under", "over"].map((name) => html`<line class=${name} x1=${drawn.from.x + 0.5}
      y1=${drawn.from.y + 0.5} x2=${drawn.to.x + 0.5} y2=${drawn.to.y + 0.5} />`)}</g>`}
    ${place && html`<g class="probe">
      <path class="under" d=${cross(place, width, height)} /><path class="over" d=${cross(place, width, height)} /></g>`}
  </svg>`;
}

function cross({ x, y }, width, height) {
  const a = height / 60, b = height / 20, u = x + 0.5, v = y + 0.5;
  return `M${u - b} ${v}H${u - a}M${u + a} ${v}H${u + b}M${u} ${v - b}V${v - a}M${u} ${v + a}V${v + b}`;
}

/** What is known at the probe. */
function Readout() {
  const place = useStore(probe);
  const [depth, deviation, amplitude, reason] = FUSED.map((topic) => useStore(images[topic]));
  const tell = (picture) => (picture && place ? measured(valueAt(picture, place), picture.unit === "m" ? "m" : "") : "–");
  const why = reason && place ? REASONS[valueAt(reason, place)] ?? "–" : "–";
  return html`<dl class="readout" aria-live="polite" aria-atomic="true">
    <${Figure} name="Depth" value=${tell(depth)} kind="main" />
    <${Figure} name="Deviation" value=${tell(deviation).replace(/^(?=\d)/, "± ")} />
    <${Figure} name="Amplitude" value=${tell(amplitude)} />
    <${Figure} name="Reason" value=${why} />
    <${Figure} name="Pixel" value=${place ? `${place.x}, ${place.y}` : "–"} />
  </dl>`;
}
