import { unzlibSync } from 'fflate';
import type { Packed } from './format';

/// Returns the bytes of whole groups of base64.
export function from_base64(text: string): Uint8Array<ArrayBuffer> {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; ++i) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

/// Streams up to this size (bytes) are inflated at once: to hand one to the browser's own code, which is faster, takes longer than that.
const kSmall = 65_536;

async function inflated(bytes: Uint8Array<ArrayBuffer>): Promise<Uint8Array<ArrayBuffer>> {
  if (bytes.length <= kSmall) return unzlibSync(bytes);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate'));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/// The bytes of a stream. `text`: base64 of all streams.
export async function unpack_bytes(text: string, packed: { at: number; size: number }): Promise<Uint8Array<ArrayBuffer>> {
  const begin = (packed.at / 3) * 4;
  const bytes = from_base64(text.slice(begin, begin + Math.ceil(packed.size / 3) * 4));
  return inflated(bytes.subarray(0, packed.size));
}

/// Reads integers from their bytes: the lowest bytes of all, then the next ones; with the sign in the lowest bit; as differences of this order.
export function integers(bytes: Uint8Array, count: number, order: number): Int32Array {
  const values = new Int32Array(count);
  let value = 0;
  let slope = 0;
  for (let i = 0; i < count; ++i) {
    const u = bytes[i]! | (bytes[count + i]! << 8) | (bytes[2 * count + i]! << 16) | (bytes[3 * count + i]! << 24);
    const d = (u >>> 1) ^ -(u & 1);
    if (order === 0) {
      value = d;
    } else if (order === 1) {
      value = (value + d) | 0;
    } else {
      slope = (slope + d) | 0;
      value = (value + slope) | 0;
    }
    values[i] = value;
  }
  return values;
}

/// The same for integers of seven bytes.
export function long_integers(bytes: Uint8Array, count: number, order: number): Float64Array {
  const values = new Float64Array(count);
  let value = 0;
  let slope = 0;
  for (let i = 0; i < count; ++i) {
    let u = 0;
    for (let k = 6; k >= 0; --k) u = u * 256 + bytes[k * count + i]!;
    const d = u % 2 === 1 ? -(u + 1) / 2 : u / 2;
    if (order === 0) {
      value = d;
    } else if (order === 1) {
      value += d;
    } else {
      slope += d;
      value += slope;
    }
    values[i] = value;
  }
  return values;
}

/// Numbers over time, with 64 bits where 32 would lose steps.
export type Column = Float32Array | Float64Array;

/// Returns the numbers of the bytes that were inflated.
export function numbers(bytes: Uint8Array, packed: Packed): Column {
  const n = packed.count;
  if (bytes.length !== n * (packed.kind === 'whole' ? 7 : 4)) throw new Error(`a stream has ${bytes.length} bytes for ${n} numbers`);
  if (packed.kind === 'whole') return long_integers(bytes, n, packed.order);
  const k = integers(bytes, n, packed.order);
  if (packed.kind === 'float') {
    const values = new Float32Array(n);
    // The integers are in the order of the numbers: those of negative numbers are mirrored.
    const bits = new Int32Array(values.buffer);
    for (let i = 0; i < n; ++i) bits[i] = k[i]! < 0 ? k[i]! ^ 0x7fffffff : k[i]!;
    return values;
  }
  const least = packed.least ?? 0;
  const step = packed.step ?? 1;
  // float32 has 24 bits: numbers that are far from 0 beside their steps, or huge, need more.
  const far = Math.max(Math.abs(least), Math.abs(least + step * 2 ** 24));
  const values = far > step * 2 ** 25 || far > 3e38 ? new Float64Array(n) : new Float32Array(n);
  for (let i = 0; i < n; ++i) values[i] = least + step * k[i]!;
  for (const [from, length, what] of packed.gaps ?? []) values.fill(what === 0 ? NaN : what * Infinity, from, from + length);
  return values;
}

export async function unpack(text: string, packed: Packed): Promise<Column> {
  return numbers(await unpack_bytes(text, packed), packed);
}
