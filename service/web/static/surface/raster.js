// Draws a mesh without the graphics card: triangles of about a pixel cost a processor less than a software
// WebGL, and where there is a graphics card it is as fast as the eye.

/** Twice the square pixels from which the colours at a triangle's corners are blended. */
const SMOOTH = 6;

/** A picture of `width` × `height` pixels, with a depth buffer. */
export class Raster {
  constructor(width, height) {
    this.image = new ImageData(width, height);
    this.pixels = new Int32Array(this.image.data.buffer);
    this.nearness = new Float32Array(width * height);
  }

  /**
   * Draw a mesh {positions, colours, cells, rows, columns} as seen through a 4 × 4 matrix.
   * A cell's bit 0 and 1 say which of the two triangles between four neighbours are there.
   */
  draw(mesh, matrix) {
    this.pixels.fill(0);
    this.nearness.fill(0);
    if (!mesh) return;
    const screen = project(mesh.positions, matrix, this.image.width, this.image.height);
    const { rows, columns, cells, colours } = mesh;
    for (let row = 0; row < rows - 1; row++) {
      for (let i = row * columns, end = i + columns - 1; i < end; i++) {
        const cell = cells[i];
        if (cell & 1) this.#triangle(screen, colours, i, i + columns, i + 1);
        if (cell & 2) this.#triangle(screen, colours, i + 1, i + columns, i + columns + 1);
      }
    }
  }

  #triangle(screen, colours, i, j, k) {
    const x0 = screen[3 * i], y0 = screen[3 * i + 1], n0 = screen[3 * i + 2];
    const x1 = screen[3 * j], y1 = screen[3 * j + 1], n1 = screen[3 * j + 2];
    const x2 = screen[3 * k], y2 = screen[3 * k + 1], n2 = screen[3 * k + 2];
    const { width, height } = this.image;
    const left = Math.max(0, Math.ceil(Math.min(x0, x1, x2)));
    const right = Math.min(width - 1, Math.floor(Math.max(x0, x1, x2)));
    if (left > right) return;
    const top = Math.max(0, Math.ceil(Math.min(y0, y1, y2)));
    const bottom = Math.min(height - 1, Math.floor(Math.max(y0, y1, y2)));
    if (top > bottom || n0 <= 0 || n1 <= 0 || n2 <= 0) return;
    const area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0);
    if (area === 0) return;
    const inverse = 1 / area, smooth = area > SMOOTH || area < -SMOOTH;
    const { nearness, pixels } = this;
    for (let y = top; y <= bottom; y++) {
      for (let x = left, p = y * width + left; x <= right; x++, p++) {
        const b = ((x - x0) * (y2 - y0) - (x2 - x0) * (y - y0)) * inverse;
        const c = ((x1 - x0) * (y - y0) - (x - x0) * (y1 - y0)) * inverse;
        const a = 1 - b - c;
        if (a < 0 || b < 0 || c < 0) continue;
        const near = a * n0 + b * n1 + c * n2;
        if (near <= nearness[p]) continue;
        nearness[p] = near;
        pixels[p] = smooth ? blend(colours[i], colours[j], colours[k], a, b, c) : colours[i];
      }
    }
  }
}

/** Columns, rows and nearness (1/w; ≤ 0 behind the eye) of each vertex on the picture. */
function project(positions, m, width, height) {
  const screen = new Float32Array(positions.length);
  const halfWidth = width / 2, halfHeight = height / 2;
  for (let i = 0; i < positions.length; i += 3) {
    const x = positions[i], y = positions[i + 1], z = positions[i + 2];
    const near = 1 / (m[3] * x + m[7] * y + m[11] * z + m[15]);
    screen[i] = halfWidth * (1 + (m[0] * x + m[4] * y + m[8] * z + m[12]) * near) - 0.5;
    screen[i + 1] = halfHeight * (1 - (m[1] * x + m[5] * y + m[9] * z + m[13]) * near) - 0.5;
    screen[i + 2] = near;
  }
  return screen;
}

function blend(p, q, r, a, b, c) {
  const red = a * (p & 255) + b * (q & 255) + c * (r & 255);
  const green = a * ((p >> 8) & 255) + b * ((q >> 8) & 255) + c * ((r >> 8) & 255);
  const blue = a * ((p >> 16) & 255) + b * ((q >> 16) & 255) + c * ((r >> 16) & 255);
  return (255 << 24) | (blue << 16) | (green << 8) | red;
}
