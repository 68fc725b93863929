// Prints every message of an MCAP file, decoded, as one JSON document.
import { readFileSync } from "node:fs";
import { argv, stdout } from "node:process";
import { McapIndexedReader } from "@mcap/core";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { decompress } from "fzstd";

const bytes = readFileSync(argv[2]);
const readable = {
  size: async () => BigInt(bytes.length),
  read: async (offset, length) => new Uint8Array(bytes.buffer, bytes.byteOffset + Number(offset), Number(length)),
};
const decompressHandlers = { zstd: (chunk, size) => decompress(chunk, new Uint8Array(Number(size))) };
const file = await McapIndexedReader.Initialize({ readable, decompressHandlers });

const readers = new Map();
const messages = [];
for await (const message of file.readMessages()) {
  const channel = file.channelsById.get(message.channelId);
  const schema = file.schemasById.get(channel.schemaId);
  if (!readers.has(schema.id)) {
    const text = new TextDecoder().decode(schema.data);
    readers.set(schema.id, new MessageReader(parse(text, { ros2: true })));
  }
  messages.push({
    topic: channel.topic,
    type: schema.name,
    log_ns: message.logTime.toString(),
    value: readers.get(schema.id).readMessage(message.data),
  });
}
const channels = Object.fromEntries([...file.channelsById.values()].map((c) => [c.topic, Object.fromEntries(c.metadata)]));
const plain = (_, value) => (ArrayBuffer.isView(value) ? Array.from(value) : value);
stdout.write(JSON.stringify({ profile: file.header.profile, channels, messages }, plain));
