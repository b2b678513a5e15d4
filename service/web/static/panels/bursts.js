// The last bursts as thumbnails, each with its report.

import { useRef, useState } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { bursts, useStore } from "../store.js";
import { clock, metres, percent, short, span } from "../format.js";
import { Figure, Panel } from "./panel.js";

export function BurstsPanel() {
  const all = useStore(bursts);
  const dialog = useRef(null);
  const [chosen, setChosen] = useState(null);
  const open = (burst) => {
    setChosen(burst);
    dialog.current.showModal();
  };
  const leave = (event) => event.target === dialog.current && dialog.current.close();
  return html`<${Panel} name="bursts" title="Last bursts">
    ${all.length === 0 && html`<p class="empty still">None yet.</p>`}
    <ul class="thumbnails">${all.map((burst) => html`<li key=${burst.key}>
      <button type="button" title="Its report" onClick=${() => open(burst)}>
        <img src=${burst.url} alt="Burst" loading="lazy" />
        <span>${burst.burst} <small>${clock(burst.time)}</small></span></button></li>`)}</ul>
    <dialog ref=${dialog} aria-label="Report of a burst" onClick=${leave}>
      ${chosen && html`<${Report} burst=${chosen} close=${() => dialog.current.close()} />`}
    </dialog>
  </${Panel}>`;
}

function Report({ burst, close }) {
  const { report } = burst;
  const rejected = Object.entries(report.rejected ?? {}).map(([n, why]) => `Frame ${n} was left out: ${why}`);
  const figures = [
    ["Method", report.method], ["Map", `${report.width} × ${report.height}`], ["Known", percent(report.known)],
    ["Median deviation", metres(report.deviation ?? NaN)],
    ["Frames", `${report.used.length} of ${report.frames} used`], ["Phases covered", percent(report.coverage)],
    ["Regularization", short(report.regularization)], ["Iterations", report.iterations],
    ["Gap", report.gap === null ? "–" : report.gap.toExponential(1)], ["Converged", report.converged ? "yes" : "no"],
    ["Registration", span(report.seconds.registration)], ["Solve", span(report.seconds.solve)],
    ["Latency", span(report.latency)], ["Contradicted", percent(report.contradicted)],
  ];
  return html`<header class="panel-head"><h2>Burst ${burst.burst}</h2>
      <button type="button" class="tool" onClick=${close}>Close</button></header>
    <div class="report"><img src=${burst.url} alt="Depth of the map" />
    <dl class="figures">${figures.map(([name, value]) => html`<${Figure} name=${name} value=${value} />`)}</dl></div>
    ${[...(report.notes ?? []), ...rejected].map((note) => html`<p class="note">${note}</p>`)}`;
}
