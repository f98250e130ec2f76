// The metrics of a run from its statistics, as slidax.analysis computes them; unknown ones are NaN.

function metricsBand(band) {
  const [mantissa, exponent] = band.toExponential().split("e");
  return `${mantissa}e${Number(exponent)}`;
}

// Metrics by key, each one number per joint, or one for the run.
export function loopMetrics(program, ended) {
  const { period, bands, joints } = program;
  const tally = (name) => ended(`tally.${name}`);
  const [samples] = tally("samples");
  const each = (compute) => Float64Array.from({ length: joints }, (_, k) => compute(k));
  const unknown = () => NaN;
  const steady = samples > Math.ceil(0.75 * (program.samples - 1));
  const integral = (total, first, last) => (k) => period * (total[k] - 0.5 * (first[k] + last[k]));
  const [first, last, early, late] = ["first_error", "last_error", "early_error", "late_error"].map(tally);
  const [squares, tau0, tau1, torqueSquares] = ["error_square", "first_torque", "last_torque", "torque_square"].map(tally);
  const square = (values) => values.map((value) => value * value);
  const duration = Math.max(samples - 1, 1) * period;
  const found = {};
  const above = tally("last_above");
  bands.forEach((band, j) => {
    const at = (k) => Math.round(Math.max(above[j * joints + k], 0) * period * 1e12) / 1e12;
    found[`settling_time.${metricsBand(band)}`] = each(at);
  });
  found.steady_error = steady ? tally("steady_error") : each(unknown);
  const mean = integral(squares, square(first), square(last));
  found.rms_error = each((k) => (samples > 1 ? Math.sqrt(Math.max(mean(k) / duration, 0)) : NaN));
  found.iae = each(integral(early.map((value, k) => value + late[k]), first, last));
  found.peak_torque = tally("peak_torque");
  found.initial_torque = each((k) => Math.abs(tau0[k]));
  found.max_torque_step = tally("max_step");
  found.steady_torque_step = steady ? tally("steady_step") : each(unknown);
  const later = samples - 1 - Math.ceil(0.75 * (program.samples - 1));
  const rms = (sum) => Math.sqrt(sum / Math.max(later, 1));
  found.steady_torque_step_rms = steady ? tally("steady_square").map(rms) : each(unknown);
  found.torque_energy = each(integral(torqueSquares, square(tau0), square(tau1)));
  found.torque_travel = tally("torque_travel");
  if (program.has_envelope) {
    found.envelope_violations = tally("violations");
    found.envelope_margin = samples > 0 ? tally("margin") : each(unknown);
  }
  const tolerance = ended("tally.tolerance.margin");
  if (tolerance !== null) {
    found.tolerance_violations = ended("tally.tolerance.outside");
    found.tolerance_margin = tolerance.every(Number.isFinite) ? tolerance : each(unknown);
  }
  for (const [part, name] of [["place", "tool_error"], ["turn", "tool_turn"]]) {
    const most = ended(`tally.tool.${part}.error`);
    if (most !== null) {
      found[name] = samples > 0 ? most : Float64Array.of(NaN);
      found[`steady_${name}`] = steady ? ended(`tally.tool.${part}.steady`) : Float64Array.of(NaN);
      const square = ended(`tally.tool.${part}.square`)[0];
      found[`rms_${name}`] = Float64Array.of(samples > 0 ? Math.sqrt(square / samples) : NaN);
    }
  }
  const promise = ended("tally.promise.margin");
  if (promise !== null) {
    found.guarantee_margin = promise;
    const [warned] = ended("tally.promise.warned");
    found.warned_at = Float64Array.of(warned >= 0 ? warned * period : NaN);
  }
  return found;
}
