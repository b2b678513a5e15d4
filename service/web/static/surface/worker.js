// Draws the surface on a thread of its own, so that the page stays quick whatever the map weighs.

import { Orbit } from "./orbit.js";
import { Raster } from "./raster.js";
import { Scene } from "./scene.js";

/** Milliseconds without a change after which everything is drawn, finely. */
const REST = 160;

const scene = new Scene(), orbit = new Orbit();
let canvas, context, raster, resting, asked = false, drawn = 0;
let size = { width: 1, height: 1, density: 1 };

const handlers = {
  canvas: (given) => {
    canvas = given;
    context = canvas.getContext("2d");
  },
  size: (given) => (size = given),
  picture: (given) => {
    scene.take(given);
    if (given.topic === "fused/depth" && scene.ready) fit();
  },
  colour: (topic) => (scene.colour = topic),
  turn: ([yaw, pitch]) => orbit.turn(yaw, pitch),
  zoom: (factor) => orbit.zoom(factor),
  shift: ([right, up]) => orbit.shift(right, up),
  reset: () => orbit.reset(),
};

onmessage = ({ data }) => {
  for (const [name, value] of Object.entries(data)) handlers[name](value);
  if ("size" in data && scene.ready) fit();
  if (!asked && canvas) requestAnimationFrame(moving);
  asked = true;
};

function fit() {
  orbit.fit(...scene.extent, size.width / size.height);
}

/** While something changes: half the rows and columns, one pixel for one. */
function moving() {
  asked = false;
  draw(2, 1);
  clearTimeout(resting);
  resting = setTimeout(() => draw(1, Math.max(2, size.density)), REST);
}

function draw(step, density) {
  if (!scene.ready) return;
  const width = Math.max(1, Math.round(size.width * density)), height = Math.max(1, Math.round(size.height * density));
  if (raster?.image.width !== width || raster.image.height !== height) {
    raster = new Raster(width, height);
    Object.assign(canvas, { width, height });
  }
  raster.draw(scene.mesh(step), orbit.matrix(width / height));
  context.putImageData(raster.image, 0, 0);
  drawn++;
  postMessage({ drawn, fine: step === 1 });
}
