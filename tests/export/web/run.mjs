// Runs one program of a playground with loop.js: node run.mjs LOOP_JS PLAYGROUND_JSON PROGRAM TIMES [plain], inputs as JSON on
// standard input; the result on standard output, as JSON in which numbers keep all their digits.

import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const [loop, playground, program, times, how] = process.argv.slice(2);
// As in a browser that does not know all instructions.
if (how === "plain") WebAssembly.validate = () => false;
const { openProgram } = await import(pathToFileURL(loop).href);
const inputs = Float64Array.from(JSON.parse(readFileSync(0, "utf8")));
const opened = await openProgram(JSON.parse(readFileSync(playground, "utf8")), program);
const milliseconds = [];
let result;
for (let k = 0; k < Number(times); k += 1) {
  result = await opened.run(inputs);
  milliseconds.push(result.milliseconds);
}
const plain = (numbers) => Array.from(numbers, (x) => (Number.isFinite(x) ? x : String(x)));
const each = (found) => Object.fromEntries(Object.entries(found).map(([name, numbers]) => [name, plain(numbers)]));
const { outcome, rows, t, signals, metrics } = result;
process.stdout.write(JSON.stringify(
  { outcome, rows, t: plain(t), signals: each(signals), metrics: each(metrics), milliseconds },
));
