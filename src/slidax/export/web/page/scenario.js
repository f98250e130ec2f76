/* The user's choice as a scenario, and as files to download. */

import { zipped } from "./archive.js";
import { exactNumber, shownNumber } from "./numbers.js";
import { unpackedJson } from "./packed.js";
import { listed } from "./playground.js";
import { toYaml } from "./yaml.js";

/* The scenario with all changed values. */
export function scenarioOf(playground, chosen) {
  const made = structuredClone(playground.setting(chosen).scenario);
  for (const [path, index] of Object.entries(chosen.choices)) {
    putAt(made, path, playground.choice(chosen, path).values[index]);
  }
  for (const [path, value] of Object.entries(chosen.values)) putAt(made, path, value);
  return made;
}

function putAt(mapping, path, value) {
  const parts = path.split(".");
  const last = parts.pop();
  let place = mapping;
  for (const part of parts) {
    if (typeof place[part] !== "object" || place[part] === null) place[part] = {};
    place = place[part];
  }
  place[last] = value;
}

export function scenarioText(playground, chosen) {
  const setting = playground.setting(chosen);
  const moved = [...Object.keys(chosen.choices), ...Object.keys(chosen.values)];
  const head = [
    `# ${playground.arm(chosen.arm).title}, ${setting.title}: from a playground made by ${playground.manifest.made_by}.`,
    moved.length ? `# Changed values: ${moved.join(", ")}.` : "# No value was changed.",
    "# slidax run FILE repeats the run.",
  ];
  return `${head.join("\n")}\n${toYaml(scenarioOf(playground, chosen))}`;
}

/* The C project and the scenario as a zip file: {archive, left}, where `left` has the paths of changed values that are not
   in the C code. Null if the setting has no C project. */
export async function projectInC(playground, chosen) {
  const setting = playground.setting(chosen);
  if (!setting.c_files) return null;
  const files = { ...(await unpackedJson(setting.c_files)) };
  const where = setting.c_parameters ?? { file: null, values: [] };
  const known = new Map((where.values ?? []).map(({ path, marks }) => [path, marks]));
  for (const [path, marks] of known) {
    let numbers = listed(playground.value(chosen, path), marks.length);
    // If the law has one number for all joints, different numbers per joint cannot be inserted.
    if (numbers.length > marks.length && numbers.some(x => x !== numbers[0])) {
      numbers = listed(playground.tunable(chosen, path).default, marks.length);
      known.delete(path);
    }
    marks.forEach((mark, k) => { files[where.file] = files[where.file].replace(mark, () => literalInC(numbers[k])); });
  }
  const moved = [...Object.keys(chosen.choices), ...Object.keys(chosen.values)];
  const left = moved.filter(path => !known.has(path) && !outsideOfLaw(path));
  const folder = "law/";
  const made = Object.fromEntries(Object.entries(files).map(([name, text]) => [folder + name, text]));
  made["scenario.yaml"] = scenarioText(playground, chosen);
  made["READ-ME.txt"] = readMe(left);
  return { archive: zipped(made), left };
}

/* True if a value belongs only to the simulated world, not to the law. */
function outsideOfLaw(path) {
  return /^(robot\.plant|disturbance|start)\b/.test(path);
}

function literalInC(x) {
  const text = exactNumber(x);
  return /[.e]/.test(text) ? text : `${text}.0`;
}

function readMe(left) {
  const again = "  slidax export c scenario.yaml --out law\n";
  if (!left.length) return `The law with the values of scenario.yaml. To export it again:\n\n${again}`;
  return `These values of scenario.yaml are NOT in this C code, which has their defaults:\n\n${left
    .map(path => `  ${path}\n`).join("")}\nTo export the law with all values of scenario.yaml:\n\n${again}`;
}

/* All curves of a chart as CSV text. */
export function columnsText(rows) {
  const columns = [];
  rows.forEach(row => {
    row.bands.forEach(band => {
      const side = band.edge === "--b" ? " of B" : "";
      columns.push([`${row.title} lower${side} [${row.unit}]`, band.low], [`${row.title} upper${side} [${row.unit}]`, band.high]);
    });
    row.lines.forEach((line, k) => columns.push([`${row.title} ${k ? "B" : "A"} [${row.unit}]`, line.curve]));
  });
  if (!columns.length) return "";
  const times = columns.map(([, one]) => one.t).reduce((a, b) => (b.length > a.length ? b : a));
  const lines = [["t [s]", ...columns.map(([name]) => `"${name}"`)].join(",")];
  const byTime = columns.map(([, one]) => (one.t.length === times.length ? null : new Map(Array.from(one.t, (t, row) => [t, row]))));
  times.forEach((t, row) => {
    const cells = columns.map(([, one], k) => {
      const at = byTime[k] ? byTime[k].get(t) : row;
      const value = at === undefined ? NaN : one.y[one.offset + at * one.stride];
      return Number.isFinite(value) ? exactNumber(value) : "";
    });
    lines.push([exactNumber(t), ...cells].join(","));
  });
  return lines.join("\n") + "\n";
}

/* Table rows for at most `most` times of a chart. */
export function thinnedRows(rows, most = 21) {
  const curves = rows.flatMap(row => row.lines.map(line => line.curve));
  if (!curves.length) return [[], []];
  const times = curves.map(one => one.t).reduce((a, b) => (b.length > a.length ? b : a));
  const several = rows.some(row => row.lines.length > 1);
  const head = ["time [s]", ...rows.flatMap(row => row.lines.map((line, k) => `${row.title}${several ? (k ? " B" : " A") : ""} [${row.unit}]`))];
  const body = [];
  for (let k = 0; k < most; k++) {
    const row = Math.round((k * (times.length - 1)) / (most - 1));
    const t = times[row];
    body.push([shownNumber(t), ...curves.map(one => {
      const value = one.t[row] === t ? one.y[one.offset + row * one.stride] : NaN;
      return shownNumber(value, 3);
    })]);
  }
  return [head, body];
}
