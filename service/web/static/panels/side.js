// Tabs beside the pictures.

import { useRef, useState } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { status, useStore } from "../store.js";
import { Settings } from "../forms/form.js";
import { Check } from "./check.js";
import { Health } from "./health.js";
import { Log } from "./log.js";
import { Recordings } from "./recordings.js";

const TABS = [["health", "Health", Health], ["settings", "Settings", Settings], ["recordings", "Recordings", Recordings],
  ["check", "Check", Check], ["log", "Log", Log]];
const KEYS = { ArrowRight: 1, ArrowLeft: -1 };

export function Side() {
  const [chosen, setChosen] = useState("health");
  const list = useRef(null);
  const move = (event) => {
    if (!KEYS[event.key]) return;
    const here = TABS.findIndex(([key]) => key === chosen);
    const next = (here + KEYS[event.key] + TABS.length) % TABS.length;
    setChosen(TABS[next][0]);
    list.current.children[next].focus();
    event.preventDefault();
  };
  const Shown = TABS.find(([key]) => key === chosen)[2];
  return html`<section class="panel side" aria-label="Details">
    <div class="tabs" role="tablist" aria-label="Details" ref=${list} onKeyDown=${move}>${TABS.map(([key, name]) => html`
      <button type="button" role="tab" id=${`tab-${key}`} aria-selected=${String(key === chosen)} aria-controls="details"
        tabindex=${key === chosen ? "0" : "-1"} onClick=${() => setChosen(key)}>
        ${name}${key === "health" && html`<${Badge} />`}</button>`)}</div>
    <div class="tab-body" role="tabpanel" id="details" aria-labelledby=${`tab-${chosen}`}><${Shown} /></div></section>`;
}

/** How many things are degraded. */
function Badge() {
  const told = useStore(status);
  const count = (told?.degraded ?? []).length + (told?.error ? 1 : 0);
  return count > 0 && html`<span class="badge" aria-label=${`${count} degraded`}>${count}</span>`;
}
