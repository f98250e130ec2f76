"""Tune a law with sliders: `pip install 'slidax[notebook]'`, then `marimo edit tune_a_law.py`."""

import marimo

app = marimo.App(width="medium")


@app.cell
def _():
    import marimo as mo

    import slidax as sx

    scenario = sx.scenarios.load("example-4.1-1khz", {"simulation.t1": 4.0})
    return mo, scenario, sx


@app.cell
def _(mo):
    gain = mo.ui.slider(0.1, 1.0, step=0.1, value=0.4, label="k1, gain of the surface [1/s]", debounce=True)
    mass = mo.ui.slider(0.5, 1.0, step=0.05, value=0.7, label="true mass of the first link [kg]", debounce=True)
    mo.vstack([gain, mass])
    return gain, mass


@app.cell
def _(gain, mass, mo, scenario):
    chosen = scenario.set({"scheme.surface.k1": gain.value, "robot.plant.masses[0]": mass.value})
    run = chosen.simulate()
    mo.as_html(run)
    return chosen, run


@app.cell
def _(run):
    run.plot.envelope()
    return


@app.cell
def _(chosen, mo, sx):
    gains = [0.2, 0.4, 0.6, 0.8]
    errors = sx.metrics.steady_error(chosen.sweep({"scheme.surface.k1": gains}))
    mo.ui.table([{"k1": k1, "steady error [rad]": float(max(row))} for k1, row in zip(gains, errors, strict=True)])
    return errors, gains


@app.cell
def _(chosen, mo):
    value, slope = chosen.grad("rms_error", "scheme.surface.k1")
    mo.md(f"Root mean square error {float(value):.3g} rad; it changes by {float(slope):+.3g} rad per unit of k1.")
    return slope, value


if __name__ == "__main__":
    app.run()
