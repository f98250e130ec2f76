// Runs a closed loop as WebAssembly: lays out its memory, calls it in pieces, and returns log, metrics and outcome.

import { loopOutcome } from "./outcome.js";
import { loopMetrics } from "./metrics.js";

const LOOP_BYTES = { f64: 8, f32: 4, i64: 8, i32: 4, u64: 8, u32: 4, b1: 1 };
const LOOP_ARRAYS = {
  f64: Float64Array, f32: Float32Array, i64: BigInt64Array, i32: Int32Array, u64: BigUint64Array, u32: Uint32Array,
  b1: Uint8Array,
};
const LOOP_PAGE = 65536;
// Approximate number of samples per call: short calls let the browser's optimising compiler take over soon.
const LOOP_CHUNK = 250;

// Decodes a text: base64 of gzip.
export async function inflateBytes(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Addresses in memory for arrays of [name, type, count, rows], each a multiple of 8.
function loopPlaces(entries, start) {
  let at = Math.ceil(start / 8) * 8;
  const places = entries.map(([, type, count, rows]) => {
    const place = at;
    at += Math.ceil((LOOP_BYTES[type] * count * rows) / 8) * 8;
    return place;
  });
  return { places, end: at };
}

// For a browser without relaxed SIMD: replaces each multiply-add in the code by a call of the same length.
function loopWithoutMadds(program, bytes) {
  const { from, to, entry, once, twice, others } = program.code;
  const kept = new Set(others);
  for (let at = from; at < to; at += 1) {
    if (bytes[at] === 0xfd && bytes[at + 1] === 0x87 && bytes[at + 2] === 0x02 && !kept.has(at)) {
      bytes.set([0x10, 0x80 | (at < entry ? once : twice), 0], at);
    }
  }
}

// A program of the manifest, ready to run.
export async function openProgram(manifest, programId) {
  const found = manifest.programs.find((one) => one.id === programId);
  if (!found) throw new Error(`the playground has no program ${programId}`);
  // The layout of its memory, which is packed since it is long and repetitive.
  const program = { ...found, ...JSON.parse(new TextDecoder().decode(await inflateBytes(found.layout))) };
  const bytes = await inflateBytes(program.wasm);
  if (!WebAssembly.validate(bytes)) loopWithoutMadds(program, bytes);
  const code = await WebAssembly.compile(bytes);
  return { run: (inputs) => runLoop(program, code, inputs) };
}

async function runLoop(program, code, inputs) {
  if (inputs.length !== program.inputs) throw new Error(`the program takes ${program.inputs} numbers`);
  const begun = performance.now();
  const { reads, writes, carried } = program;
  // The last two inputs are not part of the loop: the number of samples, and the logging stride.
  const [samples, every] = [inputs[inputs.length - 2], inputs[inputs.length - 1]];
  const chunk = Math.max(1, Math.floor(LOOP_CHUNK / every)) * every;
  const rows = Math.ceil(samples / every);
  // Memory: the table of addresses, the inputs, and the outputs. Logged outputs have room for all rows.
  const read = loopPlaces(reads.map(([type, count]) => ["", type, count, 1]), 4 * (reads.length + writes.length));
  const written = loopPlaces(
    writes.map(([name, type, count, logged]) => [name, type, count, logged ? rows : 1]), read.end,
  );
  const memory = new WebAssembly.Memory({ initial: Math.ceil(written.end / LOOP_PAGE) + 1 });
  const instance = await WebAssembly.instantiate(code, { env: { __linear_memory: memory } });
  const view = (k) => {
    const [, type, count, logged] = writes[k];
    return new LOOP_ARRAYS[type](memory.buffer, written.places[k], count * (logged ? rows : 1));
  };
  const named = (name) => {
    const k = writes.findIndex((one) => one[0] === name);
    return k < 0 ? null : view(k);
  };
  const table = new Uint32Array(memory.buffer, 0, reads.length + writes.length);
  read.places.forEach((place, k) => { table[k] = place; });
  new Float64Array(memory.buffer, read.places[0], inputs.length - 2).set(inputs.subarray(0, -2));
  const [steps, stride] = [1, 2].map((k) => new BigInt64Array(memory.buffer, read.places[k], 1));
  const fresh = new Uint8Array(memory.buffer, read.places[3], 1);
  stride[0] = BigInt(every);
  const logs = writes.filter((one) => one[3]).length;
  const kind = named("0.fault.kind");
  const bytes = new Uint8Array(memory.buffer);
  const start = {};
  for (let first = 0; first < samples; first += chunk) {
    const count = Math.min(chunk, samples - first);
    steps[0] = BigInt(count);
    fresh[0] = first === 0 ? 1 : 0;
    const before = first / every;
    writes.forEach(([, type, size, logged], k) => {
      table[reads.length + k] = written.places[k] + (logged ? before * size * LOOP_BYTES[type] : 0);
    });
    instance.exports.run(0, Math.ceil(count / every));
    if (first === 0) {
      writes.forEach(([name], k) => { if (name.startsWith("1.")) start[name.slice(2)] = Array.from(view(k)); });
    }
    if (kind[0] !== 0n) break;
    // The state at the end of this piece is the start of the next one.
    for (let k = 0; k < carried; k += 1) {
      const [, type, size] = writes[logs + k];
      const from = written.places[logs + k];
      bytes.copyWithin(read.places[4 + k], from, from + size * LOOP_BYTES[type]);
    }
  }
  const seconds = performance.now() - begun;
  const valid = named("log.valid");
  let kept = 0;
  while (kept < rows && valid[kept]) kept += 1;
  const signals = {};
  for (const { name, width } of program.signals) signals[name] = named(`log.${name}`).slice(0, kept * width);
  const ended = (name) => {
    const found = named(`0.${name}`);
    return found === null ? null : Float64Array.from(found, Number);
  };
  const run = { ...program, samples, period: start.period[0] };
  return {
    outcome: loopOutcome(run, ended, start),
    rows: kept,
    t: named("log.t").slice(0, kept),
    signals,
    metrics: loopMetrics(run, ended),
    milliseconds: seconds,
  };
}
