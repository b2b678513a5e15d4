// What is known of the rig, each piece with those who want to hear of it.

import { useEffect, useState } from "../vendor/hooks.js";

/** A value that tells its listeners when it changes. */
export class Store {
  constructor(value) {
    this.value = value;
    this.listeners = new Set();
  }

  set(value) {
    this.value = value;
    for (const listener of this.listeners) listener(value);
  }

  /** Call `listener` at each change; returns what ends that. */
  follow(listener) {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }
}

/** The value of a store in a component, drawn anew when it changes. */
export function useStore(store) {
  const [, redraw] = useState(0);
  useEffect(() => {
    redraw((n) => n + 1);
    return store.follow(() => redraw((n) => n + 1));
  }, [store]);
  return store.value;
}

const IMAGES = [
  "camera/distance", "camera/depth", "camera/amplitude",
  "fused/depth", "fused/deviation", "fused/amplitude", "fused/reason",
];

/** Pictures by topic. */
export const images = Object.fromEntries(IMAGES.map((topic) => [topic, new Store(null)]));

export const connection = new Store({ state: "connecting" });
/** The images that the server can bring. */
export const offered = new Store([]);
export const rigLink = new Store({ up: false, message: "" });
export const rig = new Store(null);
export const status = new Store(null);
export const progress = new Store(null);
export const replay = new Store(null);
export const report = new Store(null);
export const samples = new Store([]);
export const bursts = new Store([]);
export const log = new Store([]);

/** Where the probe is: {x, y} of the map, or null. */
export const probe = new Store(null);
/** The line of the profile: {from: {x, y}, to: {x, y}} of the map, or null. */
export const line = new Store(null);
/** What the user is told for a while: {text, kind}. */
export const notice = new Store(null);
