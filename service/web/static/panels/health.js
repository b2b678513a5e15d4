// How the rig is doing: what is degraded and what mends it, and plots over the last minutes.

import { useMemo } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { rigLink, samples, status, useStore } from "../store.js";
import { bytes, clock, short, span } from "../format.js";
import { axis, Chart, colour } from "./chart.js";
import { Figure } from "./panel.js";
import { theme } from "./theme.js";

/** Title, the fields of a sample, their names, and what they are multiplied with. */
const PLOTS = [
  ["Rates", "per second", ["frames", "fused"], ["frames", "maps"], 1],
  ["Lost", "per second", ["dropped", "skipped", "failed"], ["frames", "maps", "failed"], 1],
  ["Latency", "s", ["latency"], ["last frame to map"], 1],
  ["Disk", "GB free", ["free"], ["free"], 1e-9],
  ["Recording", "minutes left", ["minutes"], ["left"], 1],
];
const INKS = ["accent", "second", "bad"];

export function Health() {
  const told = useStore(status), all = useStore(samples), mode = useStore(theme);
  return html`<div class="health">
    <${Troubles} told=${told} />
    <${Figures} told=${told} />
    ${PLOTS.map(([title, unit, fields, names, factor]) => html`<${History} key=${title} title=${title} unit=${unit}
      fields=${fields} names=${names} factor=${factor} all=${all} mode=${mode} />`)}
  </div>`;
}

function Troubles({ told }) {
  const link = useStore(rigLink);
  const twins = link.up && link.rigs > 1 ? [{ what: `${link.rigs} rigs have this name.`, remedy: link.message }] : [];
  const fault = told?.error ? [{ what: told.error.what, remedy: "The last error of capture or fusion." }] : [];
  const troubles = [...twins, ...(told?.degraded ?? []), ...fault];
  if (troubles.length === 0) return html`<p class="fine">${told ? "Nothing is degraded." : "Nothing is known yet."}</p>`;
  return html`<ul class="troubles" aria-label="Degraded">${troubles.map(({ what, remedy, seconds }) => html`<li>
    <b>${what}</b> ${seconds !== undefined && html`<small>for ${span(seconds)}</small>`}
    ${remedy && html`<p>${remedy}</p>`}</li>`)}</ul>`;
}

function Figures({ told }) {
  if (!told) return null;
  const lost = Object.entries(told.drops).filter(([name, count]) => count > 0 && name !== "stale");
  const { disk, in_force: force } = told;
  const rows = [
    ["Frames", `${short(told.rates.frames)} /s`], ["Maps", `${short(told.rates.fused)} /s`], ["Latency", span(told.latency)],
    ["Source", told.source ?? "none"], ["Method", `${force.method} ×${force.upsampling}`], ["Up for", span(told.uptime)],
    ["Disk free", bytes(disk?.free)], ["Recording left", disk?.minutes == null ? "–" : span(60 * disk.minutes)],
    ["Recorded", told.recorder ? bytes(told.recorder.size) : "–"],
  ];
  return html`<dl class="figures">${rows.map(([name, value]) => html`<${Figure} name=${name} value=${value} />`)}
    <${Figure} name="Lost since the start" kind=${lost.length ? "wide warn" : "wide"}
      value=${lost.length ? lost.map(([name, count]) => `${count} ${name}`).join(", ") : "nothing"} /></dl>`;
}

function History({ title, unit, fields, names, factor, all, mode }) {
  const data = useMemo(() => columns(all, fields, factor), [all]);
  const make = useMemo(() => () => options(fields), [title]);
  const now = all.at(-1) ?? {};
  const key = (field, i) => html`<span class=${`key ${INKS[i]}`}>${names[i]}
    ${" "}<b>${now[field] == null ? "–" : short(now[field] * factor)}</b></span>`;
  const label = `${title}, ${unit}, over the last ${Math.round(all.length / 60)} minutes`;
  return html`<div class="history">
    <div class="bar-head"><b>${title}</b><small>${unit}</small>${fields.map(key)}</div>
    <${Chart} make=${make} data=${data} theme=${mode} label=${label} /></div>`;
}

/** uPlot's columns; a second without a sample is a gap. */
function columns(all, fields, factor) {
  const found = [[], ...fields.map(() => [])];
  let before = Infinity;
  const add = (row) => row.forEach((value, i) => found[i].push(value));
  for (const sample of all) {
    if (sample.time - before > 3) add([sample.time - 1, ...fields.map(() => null)]);
    add([sample.time, ...fields.map((field) => (sample[field] == null ? null : sample[field] * factor))]);
    before = sample.time;
  }
  return found;
}

/** Hours and minutes, or minutes and seconds where ticks lie closer than a minute. */
const moment = (time, step) => (step < 60 ? clock(time).slice(3, 8) : clock(time).slice(0, 5));

function options(fields) {
  return {
    legend: { show: false }, cursor: { show: false }, padding: [6, 6, 0, 0],
    scales: { x: { time: true }, y: { range: (_, low, high) => [0, high > 0 ? 1.15 * high : 1] } },
    series: [{}, ...fields.map((_, i) => ({ stroke: colour(INKS[i]), width: 1.4, points: { show: false } }))],
    axes: [
      axis({ size: 24, space: 70, values: (_, ticks, __, ___, step) => ticks.map((time) => moment(time, step)) }),
      axis({ size: 42, space: 24, values: (_, ticks) => ticks.map(short) }),
    ],
  };
}
