// The buttons that command the rig.

import { html } from "../html.js";
import { command } from "../link.js";
import { notice, rigLink, status, useStore } from "../store.js";

/** Carry out a command; what refuses it is told. */
export async function ask(name, action, args = {}, timeout = 60, done = "") {
  try {
    const reply = await command(name, action, args, timeout);
    if (done) notice.set({ text: done, kind: "good" });
    return reply;
  } catch (error) {
    notice.set({ text: error.message, kind: "bad", code: error.code });
    return null;
  }
}

/** A long burst is waited for as long as the server allows. */
const LONG = 600;

export function Actions() {
  const told = useStore(status), link = useStore(rigLink);
  const { state, paused, recorder } = told ?? {};
  const scanning = state === "scanning", streaming = state === "streaming", busy = scanning || streaming;
  const recording = Boolean(recorder?.recording);
  const button = (label, click, { on = true, kind = "", title, pressed } = {}) => html`<button type="button"
    class=${kind} disabled=${!link.up || !on} aria-pressed=${pressed} title=${title} onClick=${click}>${label}</button>`;
  return html`<div class="actions" role="toolbar" aria-label="Commands">
    ${scanning
      ? button("Stop", () => ask("cmd/scan", "stop"), { kind: "primary", on: !paused, title: "End after this burst" })
      : button("Scan", () => ask("cmd/scan", "start"), { kind: "primary", title: "Scan burst after burst" })}
    ${button("Once", () => ask("cmd/scan", "once", {}, LONG), { on: !busy, title: "Scan one burst" })}
    ${streaming
      ? button("End stream", () => ask("cmd/stream", "stop"), { title: "End after this frame" })
      : button("Stream", () => ask("cmd/stream", "start"), { title: "A map for every frame" })}
    ${paused
      ? button("Resume", () => ask("cmd/scan", "resume"), { kind: "primary" })
      : button("Pause", () => ask("cmd/scan", "pause"), { on: scanning, title: "Stand still after this pose" })}
    ${button("Cancel", () => ask("cmd/scan", "cancel"), { on: scanning, title: "End at once; this burst is discarded" })}
    <span class="gap"></span>
    ${button(recording ? html`<i class="dot"></i>Stop recording` : html`<i class="dot"></i>Record`,
      () => ask("cmd/record", recording ? "stop" : "start", {}, 60, recording ? "The recording is complete." : ""),
      { kind: recording ? "record on" : "record", pressed: String(recording) })}
    ${button("Keep", () => ask("cmd/record", "keep", {}, 60, "This recording is never deleted to make room."),
      { on: Boolean(recorder?.file), title: "Never delete this recording to make room" })}
  </div>`;
}
