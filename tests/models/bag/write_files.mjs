// Writes files/*.mcap with @mcap/core, @foxglove/rosmsg and @foxglove/rosmsg2-serialization (npm), and Debian's lz4 and zstd: node write_files.mjs files
import { McapWriter } from "@mcap/core";
import { parse } from "@foxglove/rosmsg";
import { MessageWriter } from "@foxglove/rosmsg2-serialization";
import { execFileSync } from "node:child_process";
import fs from "node:fs";

const line = "=".repeat(80);
const header = `${line}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n${line}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n`;
const jointState = `std_msgs/Header header\n\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n${header}`;
const motor = `# of our own
std_msgs/Header header
float32 temperature  # degrees
bool[3] brakes
uint8 MODE=3
int16[] codes
Point[2] ends
string<=8 label "x"
${line}
MSG: own_msgs/Point
float64 x
float64 y
${header}`;

class File {
  written = 0n;
  constructor(path) { this.file = fs.openSync(path, "w"); }
  async write(bytes) { fs.writeSync(this.file, bytes); this.written += BigInt(bytes.length); }
  position() { return this.written; }
}

async function write(path, { compression, chunks = true, index = true, order = (k) => k } = {}) {
  const options = { writable: new File(path), useChunks: chunks, chunkSize: 2000, useChunkIndex: index, useStatistics: index, useMessageIndex: index,
                    useSummaryOffsets: index, repeatChannels: index, repeatSchemas: index };
  if (compression !== undefined)
    options.compressChunk = (input) => ({ compression, compressedData: execFileSync(compression, ["-c", "-q"], { input }) });
  const writer = new McapWriter(options);
  await writer.start({ profile: "ros2", library: "" });
  const channel = async (topic, name, text) =>
    writer.registerChannel({ schemaId: await writer.registerSchema({ name, encoding: "ros2msg", data: new TextEncoder().encode(text) }),
                             topic, messageEncoding: "cdr", metadata: new Map([["offered_qos_profiles", ""]]) });
  const joints = await channel("/joint_states", "sensor_msgs/msg/JointState", jointState);
  const motors = await channel("/motor", "own_msgs/msg/Motor", motor);
  const ofJoints = new MessageWriter(parse(jointState, { ros2: true })), ofMotor = new MessageWriter(parse(motor, { ros2: true }));
  for (let k = 0; k < 60; ++k) {
    const i = order(k), ns = 1700000000000000000n + BigInt(i) * 4000000n;
    const stamp = { stamp: { sec: Number(ns / 1000000000n), nanosec: Number(ns % 1000000000n) }, frame_id: "base" };
    const names = i % 2 === 0 ? ["arm", "lift"] : ["lift", "arm"];
    const of = (arm, lift) => names.map((name) => (name === "arm" ? arm : lift));
    const add = (channelId, data) => writer.addMessage({ channelId, sequence: i, logTime: ns + 500n, publishTime: ns, data });
    await add(joints, ofJoints.writeMessage({ header: stamp, name: names, position: of(0.1 * i, 0.001 * i), velocity: of(25 + i, 0.25), effort: of(1 / (i + 1), -9.81) }));
    if (i % 10 === 0)
      await add(motors, ofMotor.writeMessage({ header: stamp, temperature: 20.5 + i, brakes: [true, false, i > 30], codes: [i, -i], ends: [{ x: i, y: 1 }, { x: 2, y: 3 }], label: "m" + i }));
  }
  await writer.end();
}

const folder = process.argv[2];
await write(`${folder}/indexed.mcap`);
await write(`${folder}/plain.mcap`, { chunks: false, index: false });
await write(`${folder}/lz4.mcap`, { compression: "lz4" });
await write(`${folder}/zstd.mcap`, { compression: "zstd", index: false });
await write(`${folder}/mixed.mcap`, { order: (k) => (k * 37) % 60 });
