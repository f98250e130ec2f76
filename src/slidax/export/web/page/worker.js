/* Runs programs in a worker, so that the page always responds. */

import { openProgram } from "./loop.js";

const openedPrograms = new Map();

function movable(result) {
  const moved = [];
  const own = array => {
    const kept = array.byteLength === array.buffer.byteLength ? array : array.slice();
    if (!moved.includes(kept.buffer)) moved.push(kept.buffer);
    return kept;
  };
  const signals = Object.fromEntries(Object.entries(result.signals).map(([name, array]) => [name, own(array)]));
  return [{ ...result, t: own(result.t), signals }, moved];
}

self.addEventListener("message", async ({ data }) => {
  const { ticket, program, id, inputs } = data;
  try {
    if (!openedPrograms.has(id)) openedPrograms.set(id, openProgram({ programs: [program] }, id));
    const opened = await openedPrograms.get(id);
    const [result, moved] = movable(inputs ? await opened.run(inputs) : { t: new Float64Array(0), signals: {} });
    self.postMessage({ ticket, result }, moved);
  } catch (error) {
    openedPrograms.delete(id);
    self.postMessage({ ticket, fault: String(error?.message ?? error) });
  }
});
