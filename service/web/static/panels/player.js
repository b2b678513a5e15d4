// The time line of a recording that is played.

import { useState } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { position } from "../format.js";
import { ask } from "./actions.js";

const SHAPES = {
  back: "M4 3v10M13 3 6.5 8l6.5 5z", play: "M4.5 3l8.5 5-8.5 5z",
  pause: "M5.5 3v10M10.5 3v10", step: "M12 3v10M3 3l6.5 5L3 13z",
};
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10, 100];

export function Player({ played }) {
  const [dragged, setDragged] = useState(null);
  const { file, mode, playing, ended, speed, loop, seconds, duration, frame, frames, burst, bursts } = played;
  const change = (action, args = {}, timeout = 60) => () => ask("cmd/replay", action, args, timeout);
  const at = dragged ?? seconds;
  const sought = async (event) => {
    await ask("cmd/replay", "seek", { seconds: Math.min(duration, Number(event.target.value)) });
    setDragged(null);
  };
  const back = mode === "scan" ? { burst: Math.max(0, burst - 1) } : { frame: Math.max(0, frame - 1) };
  const button = (label, click, shape, off = false) => html`<button type="button" aria-label=${label} title=${label}
    disabled=${off} onClick=${click}><svg viewBox="0 0 16 16" aria-hidden="true"><path d=${SHAPES[shape]} /></svg></button>`;
  return html`<div class="player" role="group" aria-label="Replay">
    <div class="bar-head"><b>${file}</b><span class="number">${position(at)} / ${position(duration)}</span></div>
    <input type="range" class="time" min="0" max=${duration || 1} step="any" value=${at} aria-label="Time line"
      aria-valuetext=${`${position(at)} of ${position(duration)}`}
      onInput=${(event) => setDragged(Number(event.target.value))} onChange=${sought} />
    <div class="player-tools">
      ${button("Step back", change("seek", back), "back", frame === 0)}
      ${playing ? button("Pause replay", change("pause"), "pause") : button("Play", change("play"), "play")}
      ${button("Step", change("step", {}, 300), "step", ended)}
      <${Speed} speed=${speed} />
      <button type="button" aria-pressed=${String(loop)} onClick=${change("loop", { loop: !loop })}>Loop</button>
      <button type="button" onClick=${change("stop")}>End</button>
    </div>
    <p class="fine">burst ${Math.min(burst + 1, bursts)} of ${bursts} · frame ${Math.min(frame + 1, frames)} of ${frames}
      ${ended && " · at its end"}${played.gap_count > 0 && ` · ${played.gap_count} gaps of its clock`}</p>
    ${played.error && html`<p class="said bad">${played.error}</p>`}</div>`;
}

function Speed({ speed }) {
  const set = ({ target }) => ask("cmd/replay", "speed", { speed: target.value === "" ? null : Number(target.value) });
  return html`<select aria-label="Speed" title="Speed" value=${speed === null ? "" : String(speed)} onChange=${set}>
    ${SPEEDS.map((times) => html`<option value=${String(times)}>${times}×</option>`)}
    <option value="">fastest</option></select>`;
}
