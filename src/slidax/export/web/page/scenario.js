/* What was chosen, as a scenario and as files. */

import { zipped } from "./archive.js";
import { exactNumber, shownNumber } from "./numbers.js";
import { unpackedJson } from "./packed.js";
import { listed } from "./playground.js";
import { toYaml } from "./yaml.js";

/* The scenario with all that was moved. */
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
    moved.length ? `# Moved: ${moved.join(", ")}.` : "# As it was given: nothing was moved.",
    "# slidax run FILE makes the same run.",
  ];
  return `${head.join("\n")}\n${toYaml(scenarioOf(playground, chosen))}`;
}

/* The project in C as a zip file, with the scenario; null if this setting has none. */
export async function projectInC(playground, chosen) {
  const setting = playground.setting(chosen);
  if (!setting.c_files) return null;
  const files = { ...(await unpackedJson(setting.c_files)) };
  const where = setting.c_parameters ?? { file: null, values: [] };
  const known = new Map((where.values ?? []).map(({ path, marks }) => [path, marks]));
  for (const [path, marks] of known) {
    let numbers = listed(playground.value(chosen, path), marks.length);
    // Where the law has one number for all joints, it cannot have one for each.
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

/* What is of the simulated world alone, and no part of the law. */
function outsideOfLaw(path) {
  return /^(robot\.plant|disturbance|start)\b/.test(path);
}

function literalInC(x) {
  const text = exactNumber(x);
  return /[.e]/.test(text) ? text : `${text}.0`;
}

function readMe(left) {
  const again = "  slidax export c scenario.yaml --out law\n";
  if (!left.length) return `The law with the numbers of scenario.yaml. To make it anew:\n\n${again}`;
  return `These numbers of scenario.yaml are NOT in the law here, which has their defaults:\n\n${left
    .map(path => `  ${path}\n`).join("")}\nThe law with all numbers of scenario.yaml is made by\n\n${again}`;
}

/* Everything that a chart shows, as comma-separated values. */
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

/* At most `most` times of a chart, as a table's rows. */
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
