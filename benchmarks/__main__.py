"""Measure everything, and write benchmarks/PERFORMANCE.md."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks import machine

TARGET = Path(__file__).with_name("PERFORMANCE.md")
HELD, XLA = "slidax, native, held", "slidax, xla, held"
REFERENCE = {"held": "example_4_1.c, held", "continuous": "example_4_1.c, continuous"}
WHAT = {
    HELD: "torque held over a period, semi-implicit Euler, metrics of every sample; machine code of our own",
    XLA: "the same by XLA",
    "slidax, native, held, every sample logged": "with all signals of all samples kept",
    "slidax, xla, held, every sample logged": "the same by XLA",
    "slidax, native, continuous (RK4)": "the law at each of the four stages, as the paper's runs",
    "slidax, xla, continuous (RK4)": "the same by XLA",
    "slidax, xla, held, library solve in the step": "a rule broken: `jnp.linalg.solve` instead of the unrolled LDLᵀ",
    "example_4_1.c, held": "C, gcc -O3: the same loop, all gains and coefficients as data",
    "example_4_1.c, continuous": "C, gcc -O3: the same, RK4 stages",
    "NumPy loop, held": "a plain Python loop over small arrays",
}


def main() -> None:
    """Run each part in a process of its own, one after the other, and write the page."""
    parts = {}
    for name in ("closed_loop", "sampled_data", "exported_c", "robots", "peer", "batch", "command_line"):
        print(f"measuring {name} ...", file=sys.stderr)
        command = [sys.executable, "-m", f"benchmarks.{name}"]
        # Nothing compiled before: the time to compile is a figure, too.
        with tempfile.TemporaryDirectory() as cache:
            environment = os.environ | {"XDG_CACHE_HOME": cache}
            answer = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=environment).stdout
        parts[name] = json.loads(answer)
    TARGET.write_text(_page(parts), encoding="utf-8")
    print(f"written: {TARGET}")


def _page(parts: dict[str, Any]) -> str:
    loop, command = parts["closed_loop"], parts["command_line"]
    times = loop["ns_per_step"]
    lines = [
        "# Performance",
        "",
        "Written by `make bench`; do not edit. Each table was measured in one run, its rows in turns, on one core",
        "unless it says otherwise. Least time of all rounds, with the median in brackets. Ratios count, not times:",
        "those are of this machine and this hour.",
        "",
        f"Machine: {machine.describe()}.",
        "",
        "## One closed loop: Example 4.1, 100 000 steps",
        "",
        "| loop | ns per step | ratio to C | compile [s] | what it is |",
        "|---|---:|---:|---:|---|",
    ]
    for name, time in times.items():
        reference = times[REFERENCE["continuous" if "continuous" in name else "held"]]["min"]
        compile_s = f"{loop['compile_s'][name]:.2f}" if name in loop["compile_s"] else ""
        lines.append(
            f"| {name} | {time['min']:,.0f} ({time['median']:,.0f}) | {time['min'] / reference:,.2f} "
            f"| {compile_s} | {WHAT[name]} |"
        )
    lines += [
        "",
        f"Goals: `{HELD}` at most 1.05 times `{REFERENCE['held']}`, here "
        f"{times[HELD]['min'] / times[REFERENCE['held']]['min']:.2f}, and traced, simplified and compiled in less than "
        f"1 s, here {loop['compile_s'][HELD]:.2f}; `{XLA}` at most 1.5 times, here "
        f"{times[XLA]['min'] / times[REFERENCE['held']]['min']:.2f}.",
        "",
        *_exported(parts["exported_c"]),
        *_robots(parts["robots"]),
        *_sampled_data(parts["sampled_data"]),
        *_opensmc(parts["peer"]),
        *_batch(parts["batch"]),
        "## The command line",
        "",
        "| command | wall time [s] |",
        "|---|---:|",
    ]
    lines += [f"| {name} | {time['min']:.2f} ({time['median']:.2f}) |" for name, time in command.items()]
    return "\n".join(lines) + "\n"


def _exported(laws: dict[str, Any]) -> list[str]:
    lines = [
        "## The exported C step",
        "",
        "200 000 steps of the closed loop, each timed by itself, by the latency program of `slidax export c`; gcc -O3;",
        "the least of five runs.",
        "",
        "| scenario | median [ns] | p99 [ns] | p99.9 [ns] | longest [ns] | lines of C |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for name, law in laws.items():
        cells = " | ".join(f"{law['ns'][share]:,.0f}" for share in ("p50", "p99", "p99.9", "max"))
        lines.append(f"| {name} | {cells} | {law['lines']} |")
    goal = (
        "Goals: a sampled-data step in less than 8,000 ns, median, and 20,000 ns, p99.9; example-4.1 in less than 1,000"
    )
    return [*lines, "", f"{goal} lines.", ""]


def _robots(robots: dict[str, Any]) -> list[str]:
    ours = robots["ns"]["slidax, native"]["min"]
    lines = [
        "## Seven joints: the Panda",
        "",
        "Forward dynamics, from state and torque to accelerations, with all parameters as data; small steps between",
        "the evaluations, and all end at the same place (benchmarks/robots.py).",
        "",
        "| program | ns per evaluation | ratio |",
        "|---|---:|---:|",
    ]
    for name, time in sorted(robots["ns"].items(), key=lambda item: item[1]["min"]):
        lines.append(f"| {name} | {time['min']:,.0f} ({time['median']:,.0f}) | {time['min'] / ours:,.1f} |")
    lines += [
        "",
        "The closed loop `panda-payload`: the sampled-data law at 1 kHz with sensor, drive, estimator and metrics, ten",
        "steps of the plant a period, on one core.",
        "",
        "| loop | times real time |",
        "|---|---:|",
    ]
    lines += [f"| {name} | {factor:,.0f} |" for name, factor in robots["real_time"].items()]
    lines += [
        "",
        "Goals: one run 50 times, a batch 200 times.",
        "",
        "| process that imports and loads | wall time [s] |",
    ]
    lines += ["|---|---:|", *(f"| {name} | {spent:.2f} |" for name, spent in robots["load_s"].items())]
    return [*lines, "", "Goal: 2 s.", ""]


def _batch(batch: dict[str, Any]) -> list[str]:
    lines = [
        f"## A batch: Example 4.1, held, {batch['runs']} runs of {batch['steps']} steps",
        "",
        "| engine | closed-loop steps per second | first call, with compiling [s] |",
        "|---|---:|---:|",
    ]
    lines += [
        f"| {name} | {steps:,.0f} | {batch['first_call_s'][name]:.1f} |" for name, steps in batch["steps_per_s"].items()
    ]
    return [*lines, "", "Goals: 3 million steps per second on one core, 5 million on two.", ""]


def _sampled_data(arms: dict[str, Any]) -> list[str]:
    laws = [name for name in next(iter(arms.values())) if not name.endswith("law alone")]
    lines = [
        "## The sampled-data law: a closed-loop step, and its ratio to the printed law's",
        "",
        "The whole step: law, plant (semi-implicit Euler, no substeps) and metrics, at 1e-4 s, where the printed law",
        "still works. The chains are benchmarks/chain.py.",
        "",
        *_ratios(arms, laws),
    ]
    worst = max(times[law]["min"] / times[laws[0]]["min"] for times in arms.values() for law in laws[1:3])
    return [
        *lines,
        "",
        f"Goal: at most 3 times the printed law, for s0 = 0 and s0 > 0; the worst here is {worst:.2f}.",
        "",
        "The law alone, over the states of a run, without plant and metrics:",
        "",
        *_ratios(arms, [f"{law}, law alone" for law in laws[:3]]),
        "",
    ]


def _ratios(arms: dict[str, Any], laws: list[str]) -> list[str]:
    """A table with the time of the first law, and that of the others with its ratio to it."""
    names = [law.removesuffix(", law alone") for law in laws]
    lines = [f"| arm | {' | '.join(f'{name} [ns]' for name in names)} |", f"|---|{'---:|' * len(laws)}"]
    for arm, times in arms.items():
        first = times[laws[0]]["min"]
        cells = [f"{first:,.0f} ({times[laws[0]]['median']:,.0f})"]
        cells += [f"{times[law]['min']:,.0f}, ratio {times[law]['min'] / first:.2f}" for law in laws[1:]]
        lines.append(f"| {arm} | {' | '.join(cells)} |")
    return lines


def _opensmc(peer: dict[str, Any]) -> list[str]:
    lines = [
        f"## OpenSMC {peer['opensmc']}: one joint, {peer['steps']} steps",
        "",
        "The same laws with the torque held, Runge-Kutta steps of the plant, every sample logged, and the same samples",
        "(tests/peers/test_opensmc.py). OpenSMC is written in NumPy and runs at once; slidax compiles first.",
        "",
        "| law | OpenSMC [ns per step] | slidax [ns per step] | ratio | slidax, no log [ns per step] "
        "| compile, first run and later ones [s] |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for law, time in peer["ns_per_step"].items():
        theirs, logged, bare = time["OpenSMC"], time["slidax, every sample logged"], time["slidax"]
        lines.append(
            f"| {law.replace('_', ' ')} | {theirs['min']:,.0f} ({theirs['median']:,.0f}) "
            f"| {logged['min']:,.0f} ({logged['median']:,.0f}) | {theirs['min'] / logged['min']:,.1f} "
            f"| {bare['min']:,.0f} ({bare['median']:,.0f}) "
            f"| {peer['compile_s'][law]:.2f}, {peer['compile_again_s'][law]:.2f} |"
        )
    return [*lines, ""]


if __name__ == "__main__":
    main()
