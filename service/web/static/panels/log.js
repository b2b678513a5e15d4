// What the rig says.

import { useEffect, useRef, useState } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { log, useStore } from "../store.js";
import { clock } from "../format.js";
import { Choice } from "./panel.js";

const LEVELS = [["all", "All"], ["warnings", "Warnings"]];
const GRAVE = new Set(["WARNING", "ERROR", "FATAL", "CRITICAL"]);

export function Log() {
  const lines = useStore(log);
  const [level, setLevel] = useState("all");
  const ref = useRef(null), following = useRef(true);
  const shown = level === "all" ? lines : lines.filter((entry) => GRAVE.has(entry.level));
  useEffect(() => {
    if (following.current) ref.current.scrollTop = ref.current.scrollHeight;
  }, [shown.length]);
  const follow = ({ currentTarget: box }) => {
    following.current = box.scrollHeight - box.scrollTop - box.clientHeight < 30;
  };
  return html`<div class="log"><${Choice} label="Lines" options=${LEVELS} value=${level} onChange=${setLevel} />
    <ol ref=${ref} tabindex="0" aria-label="Log" onScroll=${follow}>${shown.map((entry) => html`<li
      class=${entry.level.toLowerCase()}><time>${clock(entry.time)}</time>
      ${GRAVE.has(entry.level) && html`<b>${entry.level.toLowerCase()}</b>`}
      <span>${entry.message}</span></li>`)}</ol>
    ${shown.length === 0 && html`<p class="fine">Nothing was said yet.</p>`}</div>`;
}
