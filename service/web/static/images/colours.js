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

/** Near is warm and far is cool; without the darkest ends, in which no shading would be seen. */
function turbo(place) {
  const t = 0.92 - 0.84 * place;
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

/** From values to places 0 … 1 on the colour bar, and back: deviations by their logarithm. */
export function scaleOf(picture, low, high) {
  if (!picture.topic.endsWith("deviation")) {
    const width = Math.max(high - low, 1e-9);
    return { place: (value) => (value - low) / width, value: (place) => low + place * width };
  }
  const start = Math.log(Math.max(low, 1e-6)), width = Math.max(Math.log(high) - start, 1e-9);
  return { place: (value) => (Math.log(value) - start) / width, value: (place) => Math.exp(start + place * width) };
}

/** Which of the 256 colours each of the 65,536 quantised values of a picture has. */
export function colourIndices(picture, low, high) {
  const { place } = scaleOf(picture, low, high), indices = new Uint8ClampedArray(65536);
  for (let q = 1; q < 65536; q++) indices[q] = 255 * place(picture.offset + picture.scale * q);
  return indices;
}

const pack = ([r, g, b]) => (255 << 24) | (b << 16) | (g << 8) | r;

/** The picture as RGBA, coloured; what is unknown stays transparent. */
export function paint(picture, low, high) {
  const image = new ImageData(picture.width, picture.height);
  const pixels = new Int32Array(image.data.buffer);
  const { values } = picture;
  if (picture.dtype === "uint8") {
    const table = Int32Array.from(REASON_COLOURS, pack);
    for (let i = 0; i < pixels.length; i++) pixels[i] = table[values[i]];
  } else {
    const indices = colourIndices(picture, low, high);
    const table = Int32Array.from(colourTable(mapOf(picture.topic)), pack);
    for (let i = 0; i < pixels.length; i++) pixels[i] = values[i] === 0 ? 0 : table[indices[values[i]]];
  }
  return image;
}
