// What the camera sees now: distance and amplitude of single frames.

import { useEffect, useState } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { PictureCanvas } from "../images/canvas.js";
import { measured, short } from "../format.js";
import { want } from "../link.js";
import { images, useStore } from "../store.js";
import { Panel } from "./panel.js";

const RAW = [["camera/distance", "Distance"], ["camera/amplitude", "Amplitude"]];

export function FramesPanel() {
  useEffect(() => want(RAW.map(([topic]) => topic)), []);
  return html`<${Panel} name="frames" title="Camera">
    <div class="pair">${RAW.map(([topic, name]) => html`<${Raw} topic=${topic} name=${name} />`)}</div>
  </${Panel}>`;
}

function Raw({ topic, name }) {
  const picture = useStore(images[topic]);
  const [place, setPlace] = useState(null);
  const follow = (event) => {
    const box = event.currentTarget.getBoundingClientRect();
    setPlace([(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height]);
  };
  const shape = picture ?? { width: 176, height: 144 };
  return html`<figure class="raw">
    <div class="well" style=${{ aspectRatio: `${shape.width} / ${shape.height}` }} onPointerMove=${follow}
      onPointerLeave=${() => setPlace(null)}>
      <${PictureCanvas} picture=${picture} name="sharp" />${!picture && html`<p class="empty">No frame yet.</p>`}</div>
    <figcaption><span>${name}</span><span class="number">${caption(picture, place)}</span></figcaption>
  </figure>`;
}

/** The value under the pointer, else from where to where the values go. */
function caption(picture, place) {
  if (!picture) return "";
  if (!place) return `${short(picture.low)} – ${short(picture.high)} ${picture.unit}`;
  const [x, y] = [Math.floor(place[0] * picture.width), Math.floor(place[1] * picture.height)];
  const inside = x >= 0 && y >= 0 && x < picture.width && y < picture.height;
  const value = inside ? picture.at(x, y) : NaN;
  return Number.isNaN(value) ? "rejected" : measured(value, picture.unit);
}
