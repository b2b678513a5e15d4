// A plot that follows its data and its box.

import { useEffect, useRef } from "../../vendor/hooks.js";
import uPlot from "../../vendor/uplot.js";
import { html } from "../html.js";

/** A colour of the page as it is now, light or dark, for a canvas. */
export function colour(name) {
  document.head.style.color = `var(--${name})`;
  return getComputedStyle(document.head).color;
}

/** `make()` gives uPlot's options without a size; `data` its columns. */
export function Chart({ make, data, label, name = "", theme }) {
  const ref = useRef(null), plot = useRef(null);
  useEffect(() => {
    const box = ref.current;
    const size = () => ({ width: Math.max(40, box.clientWidth), height: Math.max(40, box.clientHeight) });
    plot.current = new uPlot({ ...make(), ...size() }, data, box);
    const sized = new ResizeObserver(() => plot.current.setSize(size()));
    sized.observe(box);
    return () => {
      sized.disconnect();
      plot.current.destroy();
    };
  }, [make, theme]);
  useEffect(() => plot.current.setData(data), [data]);
  return html`<div ref=${ref} class=${`chart ${name}`} role="img" aria-label=${label}></div>`;
}

/** An axis of the page's ink and hair lines. */
export function axis(more = {}) {
  return {
    stroke: colour("muted"), font: "11px system-ui, sans-serif", gap: 5,
    grid: { stroke: colour("line"), width: 1 }, ticks: { show: false }, ...more,
  };
}
