/* A scenario as YAML: mappings, lists, texts, numbers, true, false, null. Numbers are written without loss. */

import { exactNumber } from "./numbers.js";

const PLAIN_TEXT = /^[A-Za-z_][A-Za-z0-9_.\-\/]*$/;
const NO_TEXT = /^(true|false|yes|no|on|off|null|y|n|nan|inf)$/i;

export function toYaml(mapping) {
  return linesOf(mapping, "").join("\n") + "\n";
}

function linesOf(mapping, indent) {
  return Object.entries(mapping).flatMap(([key, value]) => {
    const name = `${indent}${scalar(key)}:`;
    if (isMapping(value) && Object.keys(value).length && !isShort(value)) return [name, ...linesOf(value, `${indent}  `)];
    if (Array.isArray(value) && value.some(part => isMapping(part))) {
      return [name, ...value.map(part => `${indent}  - ${flow(part)}`)];
    }
    return [`${name} ${flow(value)}`];
  });
}

function isMapping(value) {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

function isShort(value) {
  return Object.values(value).every(part => !isMapping(part)) && flow(value).length < 90;
}

function flow(value) {
  if (Array.isArray(value)) return `[${value.map(flow).join(", ")}]`;
  if (isMapping(value)) return `{${Object.entries(value).map(([key, part]) => `${scalar(key)}: ${flow(part)}`).join(", ")}}`;
  return scalar(value);
}

function scalar(value) {
  if (value === null || value === undefined) return "null";
  if (typeof value === "boolean") return String(value);
  if (typeof value === "number") return yamlNumber(value);
  if (PLAIN_TEXT.test(value) && !NO_TEXT.test(value)) return value;
  return JSON.stringify(value);
}

/* A number with a dot before its exponent, which YAML 1.1 parsers need. */
function yamlNumber(value) {
  const text = exactNumber(value);
  return /e/.test(text) && !/\./.test(text) ? text.replace("e", ".0e") : text;
}
