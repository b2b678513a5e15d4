// Reads a recording with the MCAP project's own readers, and decodes every message; prints counts as JSON.
import { open } from "node:fs/promises";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const [modules, path] = process.argv.slice(2);
const load = (name) => import(pathToFileURL(createRequire(`${modules}/`).resolve(name)).href);
const { McapIndexedReader } = await load("@mcap/core");
const { loadDecompressHandlers, protobufFromBinaryDescriptor } = await load("@mcap/support");
const { FileHandleReadable } = await load("@mcap/nodejs");

function decoderOf(channel, schema) {
  if (channel.messageEncoding === "json") {
    return (data) => JSON.parse(new TextDecoder().decode(data));
  }
  const type = protobufFromBinaryDescriptor(schema.data).lookupType(schema.name);
  return (data) => type.decode(data);
}

const file = await open(path, "r");
const reader = await McapIndexedReader.Initialize({
  readable: new FileHandleReadable(file),
  decompressHandlers: await loadDecompressHandlers(),
});
const decoders = new Map();
const found = {};
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  if (!decoders.has(message.channelId)) {
    decoders.set(message.channelId, decoderOf(channel, reader.schemasById.get(channel.schemaId)));
  }
  const value = decoders.get(message.channelId)(message.data);
  const entry = (found[channel.topic] ??= { count: 0 });
  entry.count += 1;
  entry.frame = value.frame_id || value.child_frame_id || null;
  entry.encoding = value.encoding ?? null;
  entry.bytes = value.data?.byteLength ?? null;
}
await file.close();
console.log(JSON.stringify(found));
