// Light or dark: as the system says, until somebody chooses.

import { html } from "../html.js";
import { Store, useStore } from "../store.js";

const KEY = "lidarboost-theme";
const dark = matchMedia("(prefers-color-scheme: dark)");

/** "light" or "dark", as it is shown. */
export const theme = new Store(localStorage.getItem(KEY) ?? (dark.matches ? "dark" : "light"));

function apply(mode) {
  document.documentElement.dataset.theme = mode;
}
apply(theme.value);
theme.follow(apply);
dark.addEventListener("change", () => {
  if (!localStorage.getItem(KEY)) theme.set(dark.matches ? "dark" : "light");
});

export function ThemeButton() {
  const mode = useStore(theme), other = mode === "dark" ? "light" : "dark";
  const choose = () => {
    localStorage.setItem(KEY, other);
    theme.set(other);
  };
  return html`<button type="button" class="tool round" aria-label=${`Show it ${other}`} title=${`Show it ${other}`}
    onClick=${choose}><svg viewBox="0 0 16 16" aria-hidden="true"><circle cx="8" cy="8" r="5.5" fill="none"
      stroke="currentColor" stroke-width="1.4" /><path d="M8 2.5a5.5 5.5 0 0 1 0 11z" fill="currentColor" /></svg></button>`;
}
