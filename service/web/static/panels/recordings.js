// Recordings of the rig: list, replay, download, keep, recover.

import { useEffect, useState } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { replay, rig, status, useStore } from "../store.js";
import { bytes } from "../format.js";
import { ask } from "./actions.js";
import { Player } from "./player.js";

export function Recordings() {
  const known = useStore(rig), told = useStore(status), played = useStore(replay);
  const [found, setFound] = useState(null);
  const list = async () => {
    const reply = await ask("cmd/record", "list");
    if (reply) setFound(reply);
  };
  const { recording, file } = told?.recorder ?? {};
  useEffect(() => {
    if (known) list();
  }, [known, recording, file]);
  const recordings = found?.recordings ?? [];
  return html`<div class="recordings">
    ${played?.file && html`<${Player} played=${played} />`}
    <ul class="files">${recordings.map((entry) => html`<${Entry} key=${entry.file} entry=${entry} list=${list}
      playing=${played?.file === entry.file} />`)}</ul>
    ${found && recordings.length === 0 && html`<p class="fine">Nothing is recorded yet.</p>`}
    ${found?.more > 0 && html`<p class="fine">and ${found.more} older ones</p>`}
    <button type="button" class="tool" onClick=${list}>Look again</button></div>`;
}

function Entry({ entry, list, playing }) {
  const { file, size, modified, kept, state } = entry;
  const load = () => ask("cmd/replay", "load", { file, play: true });
  const then = (action, args, done) => async () => {
    if (await ask("cmd/record", action, { file, ...args }, 300, done)) list();
  };
  const written = state === "written";
  return html`<li class=${playing ? "playing" : ""}>
    <div class="file"><b>${file}</b><small>${bytes(size)} · ${new Date(modified / 1e6).toLocaleString()}
      ${state !== "whole" && html` · <em class=${state}>${written ? "being written" : "torn"}</em>`}</small></div>
    <div class="file-tools">
      ${!written && html`<button type="button" onClick=${load} aria-label=${`Replay ${file}`}>Replay</button>
        <a class="button" href=${`/recordings/${encodeURIComponent(file)}`} download
          aria-label=${`Download ${file}`}>Download</a>`}
      <button type="button" aria-pressed=${String(kept)} aria-label=${`Keep ${file}`}
        title="Kept recordings are never deleted to make room"
        onClick=${then("keep", { keep: !kept })}>${kept ? "Kept" : "Keep"}</button>
      ${state === "torn" && html`<button type="button" aria-label=${`Recover ${file}`}
        onClick=${then("recover", {}, "What it still held is a recording of its own now.")}>Recover</button>`}
    </div></li>`;
}
