// Pointer and keys on the map: where the probe is, and a line.

import { line, probe } from "../store.js";

/** Pixels of the screen that a pointer moves before it draws a line. */
const DRAG = 5;
const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

/** Handlers for an element that shows a picture of that size; a finger draws only where `drawing`. */
export function pointing({ width, height }, drawing) {
  let from = null, start = null;
  const within = (x, y) => ({
    x: Math.max(0, Math.min(width - 1, x)), y: Math.max(0, Math.min(height - 1, y)),
  });
  const place = (event) => {
    const box = event.currentTarget.getBoundingClientRect();
    const column = Math.floor(((event.clientX - box.left) / box.width) * width);
    return within(column, Math.floor(((event.clientY - box.top) / box.height) * height));
  };
  return {
    onPointerDown(event) {
      if (event.button !== 0 || event.target.type === "range") return;
      from = place(event);
      start = [event.clientX, event.clientY];
      probe.set(from);
      if (event.pointerType !== "touch" || drawing) event.currentTarget.setPointerCapture(event.pointerId);
    },
    onPointerMove(event) {
      const here = place(event);
      probe.set(here);
      const draws = from && (event.pointerType !== "touch" || drawing);
      if (draws && Math.hypot(event.clientX - start[0], event.clientY - start[1]) > DRAG) {
        line.set({ from, to: here });
      }
    },
    onPointerUp: () => (from = null),
    onPointerCancel: () => (from = null),
    onKeyDown(event) {
      const step = KEYS[event.key], at = probe.value ?? within(width >> 1, height >> 1);
      if (step) {
        const far = event.shiftKey ? 10 : 1;
        const here = within(at.x + far * step[0], at.y + far * step[1]);
        probe.set(here);
        if (line.value?.open) line.set({ ...line.value, to: here });
      } else if (event.key === "Enter") {
        line.set(line.value?.open ? { from: line.value.from, to: at } : { from: at, to: at, open: true });
      } else if (event.key === "Escape") line.set(null);
      else return;
      event.preventDefault();
    },
  };
}
