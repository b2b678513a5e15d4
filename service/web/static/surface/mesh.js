// A depth map as triangles: positions, colours with the light in them, and no triangle across an edge.

import { colourIndices, colourTable, mapOf } from "../images/colours.js";

/** Slope, depth over width, from which neighbours belong to different things (about 84°). */
const STEEPEST = 9;
/** How much steeper a surface may be that goes on evenly: along a plane the inverse depth is linear. */
const GRAZING = 6, EVEN = 1.6;
/** Deviations by which the noise alone may part neighbours, up to a share of the depth. */
const NOISE = 3, MOST_NOISE = 0.01;

/** Light from above left, behind the viewer. */
const LIGHT = normalised([-0.45, 0.6, 0.66]);
const AMBIENT = 0.38;

function normalised(v) {
  const length = Math.hypot(...v);
  return v.map((x) => x / length);
}

/**
 * Normalised image coordinates of every `step`-th pixel, lens distortion undone by fixed-point iteration
 * (Heikkilä and Silvén, CVPR 1997; OpenCV's terms k1 k2 p1 p2 k3 k4 k5 k6).
 */
export function rays(width, height, K, lens, step) {
  const columns = Math.ceil(width / step), rows = Math.ceil(height / step);
  const xs = new Float32Array(columns * rows), ys = new Float32Array(columns * rows);
  const [k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0] = lens ?? [];
  const bent = (lens ?? []).some((term) => term !== 0);
  for (let row = 0, i = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++, i++) {
      const x0 = (column * step - K[2]) / K[0], y0 = (row * step - K[5]) / K[4];
      let x = x0, y = y0;
      for (let n = 0; bent && n < 8; n++) {
        const r = x * x + y * y;
        const radial = (1 + r * (k4 + r * (k5 + r * k6))) / (1 + r * (k1 + r * (k2 + r * k3)));
        const dx = 2 * p1 * x * y + p2 * (r + 2 * x * x), dy = p1 * (r + 2 * y * y) + 2 * p2 * x * y;
        x = (x0 - dx) * radial;
        y = (y0 - dy) * radial;
      }
      xs[i] = x;
      ys[i] = y;
    }
  }
  return { xs, ys, rows, columns };
}

/**
 * Vertices of a depth map: right, up, towards the viewer, metres, about (0, 0, −centre).
 *
 * @param depth Picture of `fused/depth`. @param grid of `rays`. @param centre metres.
 */
export function vertices(depth, grid, step, centre) {
  const { xs, ys, rows, columns } = grid;
  const positions = new Float32Array(3 * rows * columns);
  const { values, offset, scale, width } = depth;
  for (let row = 0, i = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++, i++) {
      const q = values[row * step * width + column * step];
      const z = q === 0 ? NaN : offset + scale * q;
      positions[3 * i] = xs[i] * z;
      positions[3 * i + 1] = -ys[i] * z;
      positions[3 * i + 2] = centre - z;
    }
  }
  return positions;
}

/**
 * Which of the two triangles between four neighbours are there, bit 0 and 1 of each cell: none where a depth
 * is unknown or an edge lies between.
 */
export function cells(positions, deviation, grid, step, focal, centre) {
  const { rows, columns } = grid;
  const found = new Uint8Array(rows * columns);
  const inverse = (n) => 1 / (centre - positions[3 * n + 2]);
  const parted = (a, b) => {
    const za = positions[3 * a + 2], zb = positions[3 * b + 2], jump = Math.abs(za - zb);
    const nearer = centre - Math.max(za, zb), most = (STEEPEST * step * nearer) / focal;
    const spread = deviation ? NOISE * Math.min(deviation[a], deviation[b]) : 0;
    if (jump < most + Math.min(spread, MOST_NOISE * nearer)) return false;
    if (!(jump < GRAZING * most)) return true;
    const here = inverse(b) - inverse(a), before = inverse(a) - inverse(2 * a - b), after = inverse(2 * b - a) - inverse(b);
    return !(here / before > 0 && here / before < EVEN && here / after > 0 && here / after < EVEN);
  };
  for (let row = 0; row < rows - 1; row++) {
    for (let column = 0; column < columns - 1; column++) {
      const a = row * columns + column, b = a + 1, c = a + columns, d = c + 1;
      if (parted(b, c)) continue;
      if (!parted(a, b) && !parted(a, c)) found[a] |= 1;
      if (!parted(d, b) && !parted(d, c)) found[a] |= 2;
    }
  }
  return found;
}

/**
 * How bright each vertex is, 0 … 1: Lambert's law with a fixed light. The normal is taken over `reach`
 * vertices to each side, on one side alone where the other lies across an edge.
 */
export function shade(positions, grid, reach, step, focal, centre) {
  const { rows, columns } = grid;
  const light = new Float32Array(rows * columns);
  const [lx, ly, lz] = LIGHT;
  const slope = (STEEPEST * step * reach) / focal;
  for (let row = 0, i = 0; row < rows; row++) {
    const up = Math.max(0, row - reach) * columns, down = Math.min(rows - 1, row + reach) * columns;
    for (let column = 0; column < columns; column++, i++) {
      const z = positions[3 * i + 2], most = slope * (centre - z);
      const beside = (n) => (Math.abs(positions[3 * n + 2] - z) < most ? 3 * n : 3 * i);
      const l = beside(i - Math.min(reach, column)), r = beside(i + Math.min(reach, columns - 1 - column));
      const u = beside(up + column), d = beside(down + column);
      const ax = positions[r] - positions[l], ay = positions[r + 1] - positions[l + 1];
      const az = positions[r + 2] - positions[l + 2];
      const bx = positions[u] - positions[d], by = positions[u + 1] - positions[d + 1];
      const bz = positions[u + 2] - positions[d + 2];
      const nx = ay * bz - az * by, ny = az * bx - ax * bz, nz = ax * by - ay * bx;
      const length = Math.sqrt(nx * nx + ny * ny + nz * nz);
      const cosine = length > 0 ? (nx * lx + ny * ly + nz * lz) / length : lz;
      light[i] = AMBIENT + (1 - AMBIENT) * Math.max(0, cosine);
    }
  }
  return light;
}

/** Colour of each vertex, packed RGBA: that of its value, darkened by the light. */
export function colours(picture, light, grid, step) {
  const { rows, columns } = grid, { values, width, low, high } = picture;
  const packed = new Int32Array(rows * columns);
  const table = colourTable(mapOf(picture.topic)), indices = colourIndices(picture, low, high);
  for (let row = 0, i = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++, i++) {
      const [red, green, blue] = table[indices[values[row * step * width + column * step]]];
      const bright = light[i];
      packed[i] = (255 << 24) | ((blue * bright) << 16) | ((green * bright) << 8) | (red * bright);
    }
  }
  return packed;
}
