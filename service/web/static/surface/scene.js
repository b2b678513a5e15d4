// What is shown in 3-D: the newest map, as a mesh of all its pixels and one of half its rows and columns.

import { Picture } from "../images/picture.js";
import { cells, colours, rays, shade, vertices } from "./mesh.js";

/** The newest pictures by topic, and the meshes made of them when they are asked for. */
export class Scene {
  constructor() {
    this.pictures = {};
    this.grids = {};
    this.shapes = {};
    this.colour = "fused/depth";
  }

  /** Take a picture as the page has it. */
  take(fields) {
    const picture = new Picture(fields, fields.values);
    this.pictures[picture.topic] = picture;
    if (picture.topic === "fused/depth") this.#place(picture);
  }

  get ready() {
    return Boolean(this.pictures["fused/depth"]?.intrinsics);
  }

  /** Half width, height and depth, metres. */
  get extent() {
    const { width, height, intrinsics: K, low, high } = this.pictures["fused/depth"];
    return [(this.centre * width) / (2 * K[0]), (this.centre * height) / (2 * K[4]), (high - low) / 2];
  }

  /** The mesh of every `step`-th row and column, coloured. */
  mesh(step) {
    const depth = this.pictures["fused/depth"];
    const shape = (this.shapes[step] ??= this.#shape(depth, step));
    const source = this.#coloured(depth);
    if (shape.source !== source) {
      shape.colours = colours(source, shape.light, shape.grid, step);
      shape.source = source;
    }
    return shape;
  }

  /** The picture that gives the colours; the depth where another is not there yet or of another size. */
  #coloured(depth) {
    const picture = this.pictures[this.colour];
    return picture && picture.values.length === depth.values.length ? picture : depth;
  }

  #place(depth) {
    const key = JSON.stringify([depth.width, depth.height, depth.intrinsics, depth.distortion]);
    if (key !== this.key) this.grids = {};
    this.key = key;
    this.shapes = {};
    this.centre = (depth.low + depth.high) / 2;
  }

  #shape(depth, step) {
    const { width, height, intrinsics: K, distortion } = depth;
    const grid = (this.grids[step] ??= rays(width, height, K, distortion, step));
    const positions = vertices(depth, grid, step, this.centre);
    const reach = step === 1 ? 2 : 1;
    return {
      grid, positions, rows: grid.rows, columns: grid.columns,
      cells: cells(positions, this.#deviations(depth, grid, step), grid, step, K[0], this.centre),
      light: shade(positions, grid, reach, step, K[0], this.centre),
    };
  }

  /** Deviation of each vertex, metres; null where there is none of this size. */
  #deviations(depth, grid, step) {
    const deviation = this.pictures["fused/deviation"];
    if (deviation?.values.length !== depth.values.length) return null;
    const found = new Float32Array(grid.rows * grid.columns);
    for (let i = 0; i < found.length; i++) {
      const row = Math.floor(i / grid.columns), column = i % grid.columns;
      const value = deviation.at(column * step, row * step);
      found[i] = value >= 0 ? value : 0;
    }
    return found;
  }
}
