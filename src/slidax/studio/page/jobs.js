/* The panel of jobs: start, progress and results. */
"use strict";

(() => {
  const { values, element, button, lineOf } = studioParts;

  const SOME = /\.ya?ml$/i;
  const KINDS = {
    certify: ["Certify", "Guarantees before a run, with their bounds and assumptions.",
      { scenario: "scenario", runs: ["runs of the statistical certificate", 100], out: ["folder for the report", "certificate"] }],
    run: ["Run with report", "Simulate once, with report, log and figures.", { scenario: "scenario", out: ["folder for the report", "run"] }],
    explain: ["Explain", "Explain why a run left its envelope, and test remedies.", { run: "folder" }],
    compare: ["Compare", "Compare schemes on the same task.", { scenario: "scenario", schemes: ["schemes, comma-separated", "cftsmppc,computed_torque,slotine_li"], out: ["folder for the report", "comparison"] }],
    study: ["Study", "Many runs: probabilities, worst cases, sensitivities.",
      { file: /\.ya?ml$/i, runs: ["runs (default: the file's)", ""], seed: ["seed (default: the file's)", ""], out: ["folder for rows and report", "study"], resume: false }],
    design: ["Design", "Design a law for requirements, or explain why none exists.",
      { requirements: SOME, runs: ["random cases of the check", 64], out: ["file for the scenario", "designed.yaml"] }],
    excite: ["Excite", "An excitation motion for identifying the arm.", { robot: "robot", seed: ["seed", 1], out: ["file for the motion", "motion.csv"] }],
    identify: ["Identify", "Identify rotors, friction and payload from a log.",
      { log: /\.(csv|parquet|mcap|jsonl?)$/i, robot: "robot", out: ["file for the arm", "arm.yaml"], report: ["folder for the report", "identification"] }],
    "export-c": ["Export C", "Export the law as a C99 project.", { scenario: "scenario", out: ["folder for the project", "law"], float: false }],
    "export-web": ["Export a page", "Export a playground of this scenario as one file.", { scenario: "scenario", with: ["further laws, comma-separated", "printed,computed_torque"], out: ["folder for the page", "site"] }],
  };

  studioParts.jobsPanel = ({ about, files }) => {
    const [line, say] = lineOf();
    const kind = element("select", { id: "studio-kind" });
    const form = element("div.studio-form");
    const list = element("ul.studio-jobs", { "aria-label": "Jobs" });
    const known = new Map();
    let lists = { names: [], builtIn: [], robots: [] };
    let clock = 0;

    for (const name of Object.keys(KINDS)) {
      if (about.jobs[name]) kind.append(element("option", { value: name, text: KINDS[name][0] }));
    }

    function control(name, spec) {
      const id = `studio-job-${name}`;
      if (spec === false) return element("input", { id, name, type: "checkbox" });
      if (Array.isArray(spec)) {
        const number = typeof spec[1] === "number" || name === "runs" || name === "seed";
        return element("input", { id, name, type: number ? "number" : "text", value: spec[1], autocomplete: "off" });
      }
      const folders = [...new Set(lists.names.filter(item => item.endsWith("log.parquet")).map(item => item.slice(0, -12)))];
      const choices = spec === "scenario" ? [...lists.builtIn, ...lists.names.filter(item => SOME.test(item))]
        : spec === "robot" ? [...lists.robots, ...lists.names.filter(item => /\.(urdf|xml|mjcf)$/i.test(item))]
          : spec === "folder" ? [...folders, ...lists.names.filter(item => item.endsWith(".mcap"))]
            : lists.names.filter(item => spec.test(item));
      return element("select", { id, name }, choices.map(text => element("option", { value: text, text })));
    }

    /* Keep the values of fields that remain. */
    function fill() {
      const [, meaning, fields] = KINDS[kind.value];
      const before = Object.fromEntries([...form.querySelectorAll("[name]")].map(item => [item.name, item.type === "checkbox" ? item.checked : item.value]));
      const same = form.dataset.kind === kind.value;
      form.dataset.kind = kind.value;
      form.replaceChildren(element("p.studio-meaning", { text: meaning }), ...Object.entries(fields).map(([name, spec]) => {
        const input = control(name, spec);
        const known = input.tagName === "SELECT" && [...input.options].map(item => item.value);
        if (known && known.includes(before[name] ?? lists.opened)) input.value = before[name] ?? lists.opened;
        else if (!known && same && name in before) input[input.type === "checkbox" ? "checked" : "value"] = before[name];
        return element("p.studio-field", {}, element("label", { for: input.id, text: Array.isArray(spec) ? spec[0] : name }), input);
      }));
    }

    function options() {
      const chosen = {};
      for (const item of form.querySelectorAll("[name]")) {
        if (item.type === "checkbox") { if (item.checked) chosen[item.name] = true; }
        else if (item.value !== "") chosen[item.name] = item.type === "number" ? Number(item.value) : item.value.trim();
      }
      return chosen;
    }

    async function start() {
      const request = { kind: kind.value, options: options() };
      let job;
      try {
        job = await values("POST", "/api/jobs", { json: request });
      } catch (error) {
        if (!error.exists || !confirm(`${error.message}. Overwrite?`)) throw error;
        job = await values("POST", "/api/jobs", { json: { ...request, options: { ...request.options, replace: true } } });
      }
      say(`Started ${job.command}.`, "good");
      await renew();
    }

    /* Poll while a job runs. */
    async function renew() {
      clearTimeout(clock);
      const { jobs } = await values("GET", "/api/jobs");
      const there = new Set(jobs.map(job => job.id));
      for (const [id, card] of known) if (!there.has(id)) { card.place.remove(); known.delete(id); }
      for (const job of [...jobs].reverse()) {
        if (!known.has(job.id)) {
          known.set(job.id, studioParts.jobCard(job.id, { renew, say }));
          list.prepend(known.get(job.id).place);
        }
        const ended = await known.get(job.id).show(job);
        if (ended) await files.renew();
      }
      const open = jobs.some(job => job.state === "waiting" || job.state === "running");
      if (open) clock = setTimeout(() => renew().catch(error => say(error.message, "bad")), 700);
    }

    kind.addEventListener("change", fill);
    const panel = element("div.studio-panel", {},
      element("div.studio-row", {}, element("p.studio-field", {}, element("label", { for: kind.id, text: "Command" }), kind)),
      form,
      element("div.studio-row", {}, button("Start", say, start, "button primary")),
      line, list);
    /* Preselect the last opened scenario. */
    function opened(name) {
      lists = { ...lists, opened: name };
      const control = form.querySelector("[name=scenario]");
      if (control && [...control.options].some(item => item.value === name)) control.value = name;
    }

    return { panel, renew, say, opened, list(entries) { lists = { ...entries, opened: lists.opened }; fill(); } };
  };
})();
