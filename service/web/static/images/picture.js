// An image as the server sends it: header and quantised values.

/** One image. `values` are the quantised ones; `at` gives metres or counts, NaN where unknown. */
export class Picture {
  constructor(header, values) {
    Object.assign(this, header);
    this.values = values;
  }

  /** Value at column x and row y. */
  at(x, y) {
    const q = this.values[y * this.width + x];
    if (this.dtype === "uint8") return q;
    return q === 0 ? NaN : this.offset + this.scale * q;
  }

  /** All values as float32, NaN = unknown. */
  floats() {
    const { values, scale, offset } = this;
    const result = new Float32Array(values.length);
    for (let i = 0; i < values.length; i++) result[i] = values[i] === 0 ? NaN : offset + scale * values[i];
    return result;
  }
}

/** Decode a binary frame: uint32 n, n bytes of JSON header, data. */
export async function decodePicture(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let data = buffer, start = 4 + length;
  if (header.encoding === "deflate") {
    const stream = new Blob([new Uint8Array(buffer, start)]).stream();
    data = await new Response(stream.pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
    start = 0;
  }
  const count = header.height * header.width;
  const kind = header.dtype === "uint8" ? Uint8Array : Uint16Array;
  return new Picture(header, new kind(data, start, count));
}

/** Names of the reasons of `fused/reason`. */
export const REASONS = ["measured", "filled in", "too dark", "saturated", "contradicted", "outside"];
