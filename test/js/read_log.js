// Prints what Foxglove's packages read in a log, as JSON, value by value:
//   node read_log.js LOG.mcap|FOLDER
// Twice: through the index at the end of the file, and from front to back without it.
// What JSON cannot say is an object of one entry: {"bigint": "1"}, {"number": "NaN"} (also
// Infinity, -Infinity and -0) and {"bytes": "00ff"}.

import { createReadStream } from 'node:fs';
import { open, readdir, stat } from 'node:fs/promises';
import { join } from 'node:path';

import { parse } from '@foxglove/rosmsg';
import { MessageReader } from '@foxglove/rosmsg2-serialization';
import { McapIndexedReader, McapStreamReader } from '@mcap/core';
import { loadDecompressHandlers } from '@mcap/support';

function exact(value) {
  if (typeof value === 'bigint') {
    return { bigint: value.toString() };
  }
  if (typeof value === 'number' && (!Number.isFinite(value) || Object.is(value, -0))) {
    return { number: Object.is(value, -0) ? '-0' : String(value) };
  }
  if (value instanceof Uint8Array) {
    return { bytes: Buffer.from(value).toString('hex') };
  }
  if (ArrayBuffer.isView(value) || Array.isArray(value)) {
    return Array.from(value, exact);
  }
  if (value instanceof Map) {
    return exact(Object.fromEntries(value));
  }
  if (typeof value === 'object' && value !== null) {
    return Object.fromEntries(Object.entries(value).map(([name, each]) => [name, exact(each)]));
  }
  return value;
}

class Decoder {
  #readers = new Map();

  message(record, channel, schema) {
    if (!this.#readers.has(schema.id)) {
      const text = new TextDecoder().decode(schema.data);
      this.#readers.set(schema.id, new MessageReader(parse(text, { ros2: true })));
    }
    return {
      topic: channel.topic,
      type: schema.name,
      encodings: [schema.encoding, channel.messageEncoding],
      metadata: exact(channel.metadata),
      logTime: exact(record.logTime),
      publishTime: exact(record.publishTime),
      sequence: record.sequence,
      value: exact(this.#readers.get(schema.id).readMessage(record.data)),
    };
  }
}

async function indexed(path, decompressHandlers) {
  const file = await open(path);
  try {
    const { size } = await file.stat();
    const readable = {
      size: async () => BigInt(size),
      read: async (offset, length) => {
        const bytes = new Uint8Array(Number(length));
        const { bytesRead } = await file.read(bytes, 0, bytes.length, Number(offset));
        return bytes.subarray(0, bytesRead);
      },
    };
    const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
    const decoder = new Decoder();
    const found = {
      compressions: reader.chunkIndexes.map((chunk) => chunk.compression),
      messages: [],
      attachments: [],
      metadata: [],
    };
    for await (const record of reader.readMessages()) {
      const channel = reader.channelsById.get(record.channelId);
      const schema = reader.schemasById.get(channel.schemaId);
      found.messages.push(decoder.message(record, channel, schema));
    }
    for await (const attachment of reader.readAttachments()) {
      found.attachments.push(exact(attachment));
    }
    for await (const record of reader.readMetadata()) {
      found.metadata.push(exact(record));
    }
    return found;
  } finally {
    await file.close();
  }
}

async function streamed(path, decompressHandlers) {
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  const decoder = new Decoder();
  const [channels, schemas, messages] = [new Map(), new Map(), []];
  for await (const bytes of createReadStream(path)) {
    reader.append(bytes);
    for (let record; (record = reader.nextRecord()) != undefined; ) {
      if (record.type === 'Schema') {
        schemas.set(record.id, record);
      } else if (record.type === 'Channel') {
        channels.set(record.id, record);
      } else if (record.type === 'Message') {
        const channel = channels.get(record.channelId);
        messages.push(decoder.message(record, channel, schemas.get(channel.schemaId)));
      }
    }
  }
  return { whole: reader.done(), messages };
}

let path = process.argv[2];
if ((await stat(path)).isDirectory()) {
  const [name] = (await readdir(path)).filter((each) => each.endsWith('.mcap'));
  path = join(path, name);
}
const decompressHandlers = await loadDecompressHandlers();
console.log(
  JSON.stringify({
    indexed: await indexed(path, decompressHandlers),
    streamed: await streamed(path, decompressHandlers),
  }),
);
