// What a burst would give, before it is scanned.

import { useState } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { metres, percent, short, span } from "../format.js";
import { rigLink, useStore } from "../store.js";
import { ask } from "./actions.js";
import { Figure } from "./panel.js";

export function Check() {
  const [found, setFound] = useState(null), [busy, setBusy] = useState(false);
  const link = useStore(rigLink);
  const look = async () => {
    setBusy(true);
    const reply = await ask("cmd/scan", "check", {}, 120);
    if (reply) setFound(reply.check);
    setBusy(false);
  };
  return html`<div class="check"><p class="lead">A few frames are taken with the stage at rest; nothing moves.</p>
    <button type="button" class="primary" disabled=${busy || !link.up} onClick=${look}>
      ${busy ? "Checking…" : "Check the scan"}</button>
    <div aria-live="polite">${found && html`<${Found} check=${found} />`}</div></div>`;
}

function Found({ check }) {
  const { exposure } = check;
  const shares = [
    ["Phases covered", check.coverage], ["of the rows", check.rows], ["of the columns", check.columns],
    ["Saturated", exposure.saturated], ["Dark", exposure.dark],
  ];
  return html`<ul class="advice">${check.advice.length === 0 ? html`<li class="fine">Nothing to improve.</li>`
      : check.advice.map((text) => html`<li>${text}</li>`)}</ul>
    <dl class="figures">
      <${Figure} name="Time" value=${span(check.seconds)} /><${Figure} name="Poses" value=${check.poses} />
      <${Figure} name="Noise" value=${exposure.noise === null ? "–" : metres(exposure.noise)} />
      <${Figure} name="Parallax" value=${`${short(check.parallax)} px`} />
      <${Figure} name="Frames looked at" value=${exposure.frames} /></dl>
    <div class="shares">${shares.map(([name, share]) => html`<div class="share"><span>${name}</span>
      <meter min="0" max="1" value=${share} aria-label=${name}></meter><b>${percent(share)}</b></div>`)}</div>
    <${Histogram} exposure=${exposure} />`;
}

function Histogram({ exposure }) {
  const { histogram, histogram_top: top } = exposure;
  const most = Math.max(1, ...histogram), width = 100 / histogram.length;
  const bar = (count, i) => html`<rect x=${i * width + 0.4} width=${width - 0.8} y=${30 - (30 * count) / most}
    height=${(30 * count) / most} />`;
  return html`<figure class="histogram"><svg viewBox="0 0 100 30" preserveAspectRatio="none" role="img"
      aria-label=${`Histogram of the amplitude, up to ${short(top)} counts: ${histogram.join(", ")} pixels`}>
    ${histogram.map(bar)}
    </svg><figcaption><span>0</span><span>amplitude</span><span>${short(top)} counts</span></figcaption></figure>`;
}
