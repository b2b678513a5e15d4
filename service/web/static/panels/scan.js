// How far the burst is, pose by pose, and the solve.

import { useEffect, useState } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { command } from "../link.js";
import { progress, report, rig, status, useStore } from "../store.js";
import { short, span } from "../format.js";
import { Panel } from "./panel.js";

const DEGREES = 180 / Math.PI;

export function ScanPanel() {
  const told = useStore(progress), last = useStore(report);
  const plan = usePoses();
  const captured = told?.captured ?? 0, poses = told?.poses ?? plan?.places.length ?? null;
  return html`<${Panel} name="scan" title="Scan">
    <div class="scan-body">
      <${PlanPicture} plan=${plan ?? displacements(last)} captured=${captured} />
      <div class="bars">
        <${Bar} name=${told ? `Burst ${told.burst}` : "No burst yet"} value=${captured} most=${poses}
          text=${poses ? `pose ${captured} of ${poses}` : `${captured} poses`}
          more=${told?.seconds ? `${span(told.seconds)} left` : ""} />
        <${Solve} told=${told} last=${last} />
      </div>
    </div>
  </${Panel}>`;
}

function Solve({ told, last }) {
  const solve = told?.solver;
  if (solve) {
    const most = Math.max(solve.iteration, last?.iterations ?? 0);  // as the last one took
    return html`<${Bar} name=${`Fusing burst ${solve.burst}`} value=${solve.iteration} most=${most}
      text=${`iteration ${solve.iteration}`} more=${solve.gap === null ? "" : `gap ${solve.gap.toExponential(1)}`} />`;
  }
  const waiting = told?.fusing ? `${told.fusing} waiting` : "idle";
  const done = last ? `${last.method}, ${last.iterations} iterations, ${span(last.seconds.total)}` : "";
  return html`<${Bar} name="Fusion" value=${0} most=${null} text=${waiting} more=${done} />`;
}

function Bar({ name, value, most, text, more }) {
  return html`<div class="bar"><div class="bar-head"><b>${name}</b><span>${text}</span></div>
    <progress value=${most ? value : 0} max=${most || 1} aria-label=${`${name}: ${text}`}></progress>
    <div class="bar-foot">${more}</div></div>`;
}

/** The poses of the plan, degrees; asked for again when the rig, its plan or what it plays changes. */
function usePoses() {
  const known = useStore(rig), told = useStore(status);
  const [plan, setPlan] = useState(null);
  const { frames, span: width } = told?.in_force ?? {};
  useEffect(() => {
    if (!known) return;
    command("cmd/plan", "get").then(({ poses }) => setPlan(poses ? {
      places: poses.map(([pan, tilt]) => [-pan * DEGREES, -tilt * DEGREES]), unit: "°", name: "Plan of poses",
    } : null), () => setPlan(null));
  }, [known, frames, width, told?.source]);
  return plan;
}

/** Where the frames of the last map looked, where there is no plan. */
function displacements(last) {
  if (!last?.shifts?.length) return null;
  return { places: last.shifts.map(([dy, dx]) => [dx, dy]), unit: " px", name: "Displacements of the last burst" };
}

function PlanPicture({ plan, captured }) {
  if (!plan) return html`<div class="plan empty still">No plan.</div>`;
  const { places, unit, name } = plan;
  const xs = places.map(([x]) => x), ys = places.map(([, y]) => y);
  const middle = (v) => (Math.min(...v) + Math.max(...v)) / 2;
  const size = Math.max(Math.max(...xs) - Math.min(...xs), Math.max(...ys) - Math.min(...ys)) || 1;
  const at = ([x, y]) => [50 + (80 * (x - middle(xs))) / size, 50 + (80 * (y - middle(ys))) / size];
  const dots = places.map(at), whole = captured > 0 ? captured : unit === "°" ? 0 : places.length;
  return html`<figure class="plan"><svg viewBox="0 0 100 100" role="img"
      aria-label=${`${name}: ${places.length}, ${short(size)}${unit} wide; ${whole} captured`}>
    <polyline points=${dots.map((dot) => dot.join()).join(" ")} />
    ${dots.map(([x, y], i) => html`<circle cx=${x} cy=${y} r=${i === whole ? 4.4 : 3}
      class=${i < whole ? "done" : i === whole ? "next" : ""} />`)}</svg>
    <figcaption>${short(size)}${unit}</figcaption></figure>`;
}
