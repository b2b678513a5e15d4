// What panels are made of.

import { html } from "../html.js";

/** A titled part of the page; `tools` stand beside the title. */
export function Panel({ name, title, tools, children }) {
  return html`<section class=${`panel ${name}`} aria-labelledby=${`title-${name}`}>
    <header class="panel-head"><h2 id=${`title-${name}`}>${title}</h2>${tools}</header>
    ${children}
  </section>`;
}

/** One of several: a row of buttons. `options` are [value, label]. */
export function Choice({ label, options, value, onChange }) {
  return html`<div class="choice" role="group" aria-label=${label}>${options.map(([key, text]) => html`
    <button type="button" aria-pressed=${String(key === value)} onClick=${() => onChange(key)}>${text}</button>`)}</div>`;
}

/** A figure with its name. */
export function Figure({ name, value, kind = "" }) {
  return html`<div class=${`figure ${kind}`}><dt>${name}</dt><dd>${value}</dd></div>`;
}
