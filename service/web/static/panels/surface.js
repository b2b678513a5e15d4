// The fused surface in 3-D, turned by mouse, finger or keys.

import { useEffect, useRef, useState } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { images } from "../store.js";
import { Choice, Panel } from "./panel.js";

const COLOURS = [["fused/depth", "Depth"], ["fused/amplitude", "Amplitude"], ["fused/deviation", "Deviation"]];
const KEYS = {
  ArrowLeft: { turn: [-0.06, 0] }, ArrowRight: { turn: [0.06, 0] }, ArrowUp: { turn: [0, 0.06] },
  ArrowDown: { turn: [0, -0.06] }, "+": { zoom: 1 / 1.1 }, "=": { zoom: 1 / 1.1 }, "-": { zoom: 1.1 }, Home: { reset: true },
};
/** Radians for a drag over the whole picture. */
const TURN = 3;

export function SurfacePanel() {
  const ref = useRef(null), tell = useRef(() => {});
  const [colour, setColour] = useState("fused/depth");
  useEffect(() => {
    const ended = run(ref.current, tell);
    return ended;
  }, []);
  useEffect(() => tell.current({ colour }), [colour]);
  const tools = html`<${Choice} label="Colour of the surface" options=${COLOURS} value=${colour} onChange=${setColour} />
    <button type="button" class="tool" onClick=${() => tell.current({ reset: true })}>Reset</button>`;
  return html`<${Panel} name="surface" title="Surface" tools=${tools}>
    <canvas ref=${ref} class="surface-view" tabindex="0" role="application"
      aria-label="Fused surface in 3-D. Arrow keys turn it, plus and minus zoom, Home resets." ...${gestures(tell)}></canvas>
    <p class="hint">Drag turns · wheel or pinch zooms · Shift-drag moves</p>
  </${Panel}>`;
}

/** Start the thread that draws on `canvas`; returns what ends it. */
function run(canvas, tell) {
  const worker = new Worker(new URL("../surface/worker.js", import.meta.url), { type: "module" });
  const surface = canvas.transferControlToOffscreen();
  worker.postMessage({ canvas: surface }, [surface]);
  worker.onmessage = ({ data }) => Object.assign(canvas.dataset, data);
  tell.current = (message) => worker.postMessage(message);
  const sized = new ResizeObserver(() => {
    tell.current({ size: { width: canvas.clientWidth, height: canvas.clientHeight, density: devicePixelRatio } });
  });
  sized.observe(canvas);
  const followed = COLOURS.map(([topic]) => images[topic].follow((picture) => tell.current({ picture: { ...picture } })));
  return () => {
    followed.forEach((end) => end());
    sized.disconnect();
    worker.terminate();
  };
}

/** What pointers and keys do. */
function gestures(tell) {
  const fingers = new Map();
  const spread = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a.x - b.x, a.y - b.y);
  };
  return {
    onPointerDown(event) {
      event.currentTarget.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    },
    onPointerMove(event) {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const apart = fingers.size === 2 ? spread() : 0;
      const { clientHeight: height } = event.currentTarget;
      const right = (event.clientX - before.x) / height, down = (event.clientY - before.y) / height;
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (fingers.size === 2) tell.current({ zoom: apart / spread(), shift: [right / 2, -down / 2] });
      else if (event.shiftKey) tell.current({ shift: [right, -down] });
      else tell.current({ turn: [TURN * right, TURN * down] });
    },
    onPointerUp: (event) => fingers.delete(event.pointerId),
    onPointerCancel: (event) => fingers.delete(event.pointerId),
    onWheel(event) {
      event.preventDefault();
      tell.current({ zoom: Math.exp(event.deltaY / 800) });
    },
    onKeyDown(event) {
      if (!KEYS[event.key]) return;
      tell.current(KEYS[event.key]);
      event.preventDefault();
    },
  };
}
