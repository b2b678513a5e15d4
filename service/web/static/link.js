// The connection to the page's server: it comes back by itself, carries commands, and asks for images.

import { decodePicture } from "./images/picture.js";
import * as store from "./store.js";

const SHORTEST = 500, LONGEST = 5000;
const MOST_SAMPLES = 600, MOST_LINES = 500, MOST_BURSTS = 12;
const DISPLACED = 4408, NO_TOKEN = 4401;

const MESSAGES = {
  status: store.status, "scan/progress": store.progress, "replay/state": store.replay, "fused/report": store.report,
};

/** A command that was refused; `code` as the rig names it. */
class CommandError extends Error {
  constructor(code, message) {
    super(message);
    this.code = code;
  }
}

let socket, wait = SHORTEST, number = 0;
const pending = new Map(), wanted = new Map();

/** Connect, and stay connected. */
export function connect() {
  const scheme = location.protocol === "https:" ? "wss:" : "ws:";
  socket = new WebSocket(`${scheme}//${location.host}/ws`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    wait = SHORTEST;
    store.connection.set({ state: "open" });
  };
  socket.onmessage = ({ data }) => (typeof data === "string" ? take(JSON.parse(data)) : takePicture(data));
  socket.onclose = closed;
}

function closed({ code }) {
  for (const { reject } of pending.values()) {
    reject(new CommandError("UNREACHABLE", "the connection to the page's server was lost; it may be carried out yet"));
  }
  pending.clear();
  if (code === NO_TOKEN) location.assign("/");
  else if (code === DISPLACED) {
    store.connection.set({ state: "displaced" });
    addEventListener("pointerdown", connect, { once: true });
  } else {
    store.connection.set({ state: "lost" });
    setTimeout(connect, wait);
    wait = Math.min(LONGEST, 2 * wait);
  }
}

function send(message) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

/** Have a command carried out; resolves to the reply, rejects with a CommandError. */
export function command(name, action, args = {}, timeout = 60) {
  if (socket?.readyState !== WebSocket.OPEN) {
    return Promise.reject(new CommandError("UNREACHABLE", "there is no connection to the page's server"));
  }
  const id = ++number;
  send({ type: "command", id, name, action, arguments: args, timeout });
  return new Promise((resolve, reject) => pending.set(id, { resolve, reject }));
}

/** Ask for images as long as somebody shows them; returns what ends that. */
export function want(topics) {
  const key = {};
  wanted.set(key, topics);
  show();
  return () => {
    wanted.delete(key);
    show();
  };
}

let asking = false;

/** Tell the server once what is wanted now, however many changes come together. */
function show() {
  if (asking) return;
  asking = true;
  queueMicrotask(() => {
    asking = false;
    const topics = new Set([...wanted.values()].flat());
    const images = document.hidden ? [] : store.offered.value.filter((topic) => topics.has(topic));
    if (store.offered.value.length > 0) send({ type: "show", images });
  });
}
document.addEventListener("visibilitychange", () => {
  show();
  if (!document.hidden && store.connection.value.state === "displaced") connect();
});

async function takePicture(buffer) {
  const picture = await decodePicture(buffer);
  store.images[picture.topic]?.set(picture);
  requestAnimationFrame(() => send({ type: "ack", topic: picture.topic }));
}

const handlers = {
  hello: ({ images }) => {
    store.log.set([]);
    store.samples.set([]);
    store.offered.set(images);
    show();
  },
  link: (message) => {
    if (!message.up) store.status.set(null);
    store.rigLink.set(message);
  },
  rig: (message) => store.rig.set(message),
  history: ({ samples }) => store.samples.set(samples),
  sample: ({ sample }) => store.samples.set([...store.samples.value, sample].slice(-MOST_SAMPLES)),
  log: ({ lines }) => store.log.set([...store.log.value, ...lines].slice(-MOST_LINES)),
  bursts: ({ bursts }) => store.bursts.set(bursts),
  burst: ({ burst }) => store.bursts.set([burst, ...store.bursts.value].slice(0, MOST_BURSTS)),
  message: ({ topic, value }) => MESSAGES[topic]?.set(value),
  answer: ({ id, value }) => settle(id, ({ resolve }) => resolve(value)),
  error: ({ id, code, message }) => {
    if (id === null) console.error(message);
    else settle(id, ({ reject }) => reject(new CommandError(code, message)));
  },
};

function take(message) {
  handlers[message.type]?.(message);
}

function settle(id, how) {
  const waiting = pending.get(id);
  pending.delete(id);
  if (waiting) how(waiting);
}
