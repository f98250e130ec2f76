// The outcome of a run, with the messages of slidax.simulation.

import { capitalised } from "./numbers.js";

// A number with `digits` significant digits, as Python's format "g" writes it.
export function shortNumber(value, digits) {
  if (value === 0) return Object.is(value, -0) ? "-0" : "0";
  if (!Number.isFinite(value)) return Number.isNaN(value) ? "nan" : value > 0 ? "inf" : "-inf";
  const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
  const power = Number(exponent);
  const trim = (text) => (text.includes(".") ? text.replace(/\.?0+$/, "") : text);
  if (power < -4 || power >= digits) {
    return `${trim(mantissa)}e${power < 0 ? "-" : "+"}${String(Math.abs(power)).padStart(2, "0")}`;
  }
  return trim(value.toFixed(digits - 1 - power));
}

// "joint 2", or "joint `elbow`" if the joint has a name.
function outcomeJoint(program, joint) {
  const name = program.joint_names[joint];
  return /^joint \d+$/.test(name) ? name : `joint \`${name}\``;
}

function outcomeMet(program, joint, how, error, bound) {
  const unit = program.joint_units[joint];
  const numbers = `e = ${shortNumber(error, 4)} ${unit}, bound ${shortNumber(bound, 4)} ${unit}`;
  return `${capitalised(outcomeJoint(program, joint))} ${how} (${numbers})`;
}

// The message for a start that `simulate` rejects; null if the run may begin.
function outcomeRefused(program, start) {
  if (start.held) {
    const joint = start.held.findIndex((torque, k) => Math.abs(torque) > start.limit[k]);
    if (joint >= 0) {
      const unit = program.joint_units[joint] === "rad" ? "N m" : "N";
      return `The drives cannot hold the arm where it starts: ${outcomeJoint(program, joint)} needs ` +
        `${shortNumber(start.held[joint], 4)} ${unit} there, but its limit is ${shortNumber(start.limit[joint], 6)} ${unit}.`;
    }
  }
  for (const [lower, upper, name, symbol] of [["tolerance_lower", "tolerance_upper", "tolerance band", "|e(0)| < rho0"],
    ["lower", "upper", "envelope", "lower < e(0) < upper"]]) {
    if (!start[lower]) continue;
    const joint = start.e.findIndex((e, k) => e <= start[lower][k] || e >= start[upper][k]);
    if (joint >= 0) {
      return `The ${name} must hold the start, ${symbol}; got e(0) = ${shortNumber(start.e[joint], 4)} for ` +
        `${outcomeJoint(program, joint)}; enlarge its initial radius.`;
    }
  }
  return null;
}

// The outcome: kind, message, time and joint.
export function loopOutcome(program, ended, start) {
  const refused = outcomeRefused(program, start);
  if (refused !== null) return { kind: "refused", message: refused, time: 0, joint: null };
  const kind = ended("fault.kind")[0];
  const excursion = ended("excursion.first");
  const outside = excursion !== null && ended("excursion.outside")[0] !== 0;
  if (kind === 0) {
    if (excursion !== null && excursion[0] >= 0) return outcomeExcursion(program, ended, outside);
    return { kind: "ok", message: "The run reached its end.", time: null, joint: null };
  }
  const [t, joint] = [ended("fault.t")[0], ended("fault.joint")[0]];
  const time = shortNumber(t, 4);
  if (kind === 2) {
    const remedy = outside
      ? "It was outside its envelope, where the law is not defined: use its sampled-data form."
      : t === 0
      ? "The law's torque is not a number at the start: check its `init`, divisions, roots and logarithms."
      : "Shorten the period, or lower the gains; the run up to there is kept.";
    const message = `${capitalised(outcomeJoint(program, joint))} became infinite or undefined at t = ${time} s. ${remedy}`;
    return { kind: "not_finite", message, time: t, joint: joint + 1 };
  }
  const met = outcomeMet(program, joint, `left its envelope at t = ${time} s`, ended("fault.error")[0], ended("fault.bound")[0]);
  const message = `${met}. Start inside it, enlarge its final radius, or shorten the period.`;
  return { kind: "left_envelope", message, time: t, joint: joint + 1 };
}

function outcomeExcursion(program, ended, outside) {
  const [first, last, joint] = ["first", "last", "joint"].map((name) => ended(`excursion.${name}`)[0]);
  const [t, back] = [first * program.period, (last + 1) * program.period];
  const beyond = ended("excursion.beyond");
  const worst = beyond.indexOf(Math.max(...beyond));
  const how = first === 0 ? "was outside its envelope from the start" : `left its envelope at t = ${shortNumber(t, 4)} s`;
  const met = outcomeMet(program, joint, how, ended("excursion.error")[0], ended("excursion.bound")[0]);
  const violations = ended("tally.violations")[0];
  const samples = violations === 1 ? "1 sample was outside" : `${violations} samples were outside`;
  const extent = `${samples}, by at most ${shortNumber(beyond[worst], 3)} ${program.joint_units[worst]} (${outcomeJoint(program, worst)})`;
  if (outside) {
    const message = `${met} and is outside at the end: ${extent}.`;
    return { kind: "left_envelope", message, time: t, joint: joint + 1 };
  }
  const message = `${met}, and was back for good at t = ${shortNumber(back, 4)} s: ${extent}.`;
  return { kind: "recovered", message, time: t, joint: joint + 1 };
}
