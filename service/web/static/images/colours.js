// Colour maps, and the tables from quantised values to pixels made of them.

// Turbo: Mikhailov, "Turbo, an improved rainbow colormap", Google AI Blog 2019; polynomial by R. Du.
const TURBO = [
  [0.1357, 4.5974, -42.3277, 130.5887, -150.5666, 58.1375],
  [0.0914, 2.1856, 4.8052, -14.0195, 4.2109, 2.7747],
  [0.1067, 12.5925, -60.1097, 109.0745, -88.5066, 26.8183],
];

// Anchors of viridis (van der Walt and Smith, matplotlib 2015), evenly spaced.
const VIRIDIS = [
  [68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141],
  [39, 173, 129], [92, 200, 99], [170, 220, 50], [253, 231, 37],
];

const GRAYS = [[12, 14, 18], [246, 247, 249]];

/** Colours of the reasons measured, filled, dark, saturated, contradicted, outside. */
export const REASON_COLOURS = [
  [74, 144, 154], [157, 196, 189], [64, 68, 82], [233, 172, 60], [205, 84, 84], [128, 132, 144],
];

const clamp = (value) => Math.max(0, Math.min(255, Math.round(value)));

function turbo(t) {
  return TURBO.map((terms) => clamp(255 * terms.reduceRight((sum, term) => sum * t + term, 0)));
}

function between(anchors, t) {
  const place = t * (anchors.length - 1);
  const index = Math.min(anchors.length - 2, Math.floor(place));
  return anchors[index].map((a, c) => clamp(a + (place - index) * (anchors[index + 1][c] - a)));
}

const MAPS = {
  turbo,
  viridis: (t) => between(VIRIDIS, t),
  gray: (t) => between(GRAYS, t),
};

const tables = {};

/** 256 colours [r, g, b] of a map. */
export function colourTable(name) {
  tables[name] ??= Array.from({ length: 256 }, (_, i) => MAPS[name](i / 255));
  return tables[name];
}

/** How values of a topic are coloured. */
export function mapOf(topic) {
  if (topic.endsWith("amplitude")) return "gray";
  return topic.endsWith("deviation") ? "viridis" : "turbo";
}

const pack = ([r, g, b]) => (255 << 24) | (b << 16) | (g << 8) | r;

/**
 * Table of 65,536 packed RGBA pixels for quantised values of a picture between `low` and `high`.
 * Value 0, unknown, stays transparent.
 */
export function pixelTable(picture, name, low, high) {
  const table = new Int32Array(65536);
  const packed = colourTable(name).map(pack);
  const factor = 255 / Math.max(high - low, 1e-9);
  for (let q = 1; q < 65536; q++) {
    const t = (picture.offset + picture.scale * q - low) * factor;
    table[q] = packed[t > 255 ? 255 : t < 0 ? 0 : t | 0];
  }
  return table;
}

/** The picture as RGBA, coloured. */
export function paint(picture, low, high) {
  const image = new ImageData(picture.width, picture.height);
  const pixels = new Int32Array(image.data.buffer);
  const table = picture.dtype === "uint8"
    ? Int32Array.from(REASON_COLOURS, pack)
    : pixelTable(picture, mapOf(picture.topic), low, high);
  const { values } = picture;
  for (let i = 0; i < pixels.length; i++) pixels[i] = table[values[i]];
  return image;
}
