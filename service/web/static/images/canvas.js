// A picture on the page: painted when it changes, never scaled by the script.

import { useEffect, useRef } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { colourTable, mapOf, paint, REASON_COLOURS, scaleOf } from "./colours.js";
import { REASONS } from "./picture.js";
import { short } from "../format.js";

/** The picture between `low` and `high` in its topic's colours. */
export function PictureCanvas({ picture, low = picture?.low, high = picture?.high, name = "" }) {
  const ref = useRef(null);
  useEffect(() => {
    if (!picture) return;
    const canvas = ref.current;
    if (canvas.width !== picture.width || canvas.height !== picture.height) {
      Object.assign(canvas, { width: picture.width, height: picture.height });
    }
    canvas.getContext("2d").putImageData(paint(picture, low, high), 0, 0);
    Object.assign(canvas.dataset, { sequence: picture.sequence, published: picture.published });
  }, [picture, low, high]);
  return html`<canvas ref=${ref} class=${`picture ${name}`} width="176" height="144" aria-hidden="true"></canvas>`;
}

/** What the colours mean: values from `low` to `high`, and a mark at `value`. */
export function ColourBar({ picture, low, high, value }) {
  const ref = useRef(null);
  const map = picture ? mapOf(picture.topic) : "turbo";
  useEffect(() => {
    const context = ref.current?.getContext("2d");
    if (!context) return;
    const row = context.createImageData(256, 1);
    colourTable(map).forEach(([r, g, b], i) => row.data.set([r, g, b, 255], 4 * i));
    context.putImageData(row, 0, 0);
  }, [map, picture?.dtype]);
  if (picture?.dtype === "uint8") return html`<${ReasonKey} />`;
  const milli = Boolean(picture?.topic.endsWith("deviation"));
  const unit = milli ? "mm" : picture?.unit;
  const scale = picture && scaleOf(picture, low, high);
  const ticks = picture ? [0, 0.25, 0.5, 0.75, 1].map((t) => short(scale.value(t) * (milli ? 1000 : 1))) : [];
  const place = picture ? scale.place(value) : NaN;
  const known = Number.isFinite(place);
  return html`<div class="colour-bar" role="img"
      aria-label=${picture ? `colours from ${ticks[0]} to ${ticks[4]} ${unit}` : "colours"}>
    <div class="gradient"><canvas ref=${ref} width="256" height="1"></canvas>
      ${known && html`<i class="mark" style=${{ left: `${100 * Math.max(0, Math.min(1, place))}%` }}></i>`}</div>
    <div class="ticks">${ticks.map((tick, i) => html`<span>${tick}${i === 4 ? ` ${unit}` : ""}</span>`)}</div>
  </div>`;
}

function ReasonKey() {
  return html`<ul class="reason-key">${REASONS.map((name, i) => html`<li><i
      style=${{ background: `rgb(${REASON_COLOURS[i].join(" ")})` }}></i>${name}</li>`)}</ul>`;
}
