// Above everything: who the rig is, what it does and why, and what the user was told last.

import { useEffect } from "../../vendor/hooks.js";
import { html } from "../html.js";
import { connection, notice, rig, rigLink, status, useStore } from "../store.js";
import { span } from "../format.js";
import { ThemeButton } from "./theme.js";
import { Actions } from "./actions.js";

const SHOWN = 8000;

export function Heading() {
  const told = useStore(status), known = useStore(rig);
  const name = told?.model ?? known?.manifest?.model ?? "";
  return html`<header class="heading">
    <h1><svg class="logo" viewBox="0 0 32 32" aria-hidden="true" fill="none" stroke="currentColor" stroke-width="3">
      <path d="M6 24 16 8l10 16" stroke-linejoin="round" /><path d="M10 24h12" /></svg>
      <span class="brand">lidarboost</span> <small>${name}</small></h1>
    <${State} />
    <${Actions} />
    <${ThemeButton} />
  </header><${Notice} />`;
}

function State() {
  const told = useStore(status), link = useStore(rigLink), { state: joined } = useStore(connection);
  const [word, reason, kind] = state(told, link, joined);
  return html`<p class=${`state ${kind}`} role="status"><b>${word}</b><span class="reason">${reason}</span></p>`;
}

function state(told, link, joined) {
  if (joined === "displaced") return ["asleep", "too many pages are open; touch this one to go on with it", "bad"];
  if (joined !== "open") return ["no server", "the page's server does not answer; it is tried again", "bad"];
  if (!link.up) return ["no rig", link.message, "bad"];
  if (!told) return ["connected", "", ""];
  const word = told.paused ? `${told.state}, paused` : told.state;
  const trouble = told.degraded[0]?.what ?? told.error?.what;
  if (trouble) return [word, trouble, "warn"];
  const kind = { scanning: "busy", streaming: "busy", recovering: "bad", idle: "" }[told.state] ?? "warn";
  return [word, [told.reason, `for ${span(told.seconds)}`].filter(Boolean).join(" · "), told.paused ? "warn" : kind];
}

function Notice() {
  const told = useStore(notice);
  useEffect(() => {
    if (!told) return undefined;
    const timer = setTimeout(() => notice.set(null), SHOWN);
    return () => clearTimeout(timer);
  }, [told]);
  return html`<div class="notices" role="alert">${told && html`<div class=${`notice ${told.kind}`}>
    <span>${told.text}${told.code && html` <small>${told.code}</small>`}</span>
    <button type="button" class="tool" aria-label="Dismiss" onClick=${() => notice.set(null)}>✕</button></div>`}</div>`;
}
