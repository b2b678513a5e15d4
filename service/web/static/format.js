// Numbers as people read them.

/** Three significant digits, without exponent. */
export function short(value) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (value === 0) return "0";
  if (Math.abs(value) >= 10000) return Math.round(value).toLocaleString("en").replaceAll(",", "\u2009");
  const digits = Math.max(0, 2 - Math.floor(Math.log10(Math.abs(value))));
  return value.toFixed(Math.min(digits, 6)).replace(/(\.\d*?)0+$/, "$1").replace(/\.$/, "");
}

/** Metres; millimetres where it is less than 0.1 m. */
export function metres(value) {
  if (!Number.isFinite(value)) return "–";
  return Math.abs(value) < 0.1 ? `${short(1000 * value)} mm` : `${value.toFixed(3)} m`;
}

/** A value of a picture with its unit. */
export function measured(value, unit) {
  return unit === "m" ? metres(value) : `${short(value)} ${unit}`.trim();
}

/** Bytes. */
export function bytes(value) {
  if (value === null || value === undefined) return "–";
  const units = ["B", "kB", "MB", "GB", "TB"];
  const power = Math.min(units.length - 1, value > 0 ? Math.floor(Math.log10(value) / 3) : 0);
  return `${short(value / 1000 ** power)} ${units[power]}`;
}

/** Seconds as a span of time. */
export function span(seconds) {
  if (seconds === null || seconds === undefined) return "–";
  if (seconds < 1) return `${short(1000 * seconds)} ms`;
  if (seconds < 120) return `${short(seconds)} s`;
  if (seconds < 7200) return `${Math.round(seconds / 60)} min`;
  return seconds < 172800 ? `${Math.round(seconds / 3600)} h` : `${Math.round(seconds / 86400)} d`;
}

/** Minutes and seconds of a time line. */
export function position(seconds) {
  const minutes = Math.floor(seconds / 60);
  return `${minutes}:${(seconds - 60 * minutes).toFixed(1).padStart(4, "0")}`;
}

/** A share; small ones as a bound. */
export function percent(share) {
  if (!Number.isFinite(share)) return "–";
  return share > 0 && share < 0.001 ? "< 0.1 %" : `${short(100 * share)} %`;
}

/** Time of day of seconds since the epoch. */
export const clock = (time) => new Date(1000 * time).toLocaleTimeString([], { hour12: false });
