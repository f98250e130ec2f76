/* The panel with long things: what can be started, what runs, and what came of it. */
"use strict";

(() => {
  const { values, element, button, lineOf } = studioParts;

  const SOME = /\.ya?ml$/i;
  const KINDS = {
    certify: ["Certify", "What is promised before a run, and on what it stands.",
      { scenario: "scenario", runs: ["runs of the statistical certificate", 100], out: ["folder of the report", "certificate"] }],
    run: ["Run with report", "One run with report, log and figures.", { scenario: "scenario", out: ["folder of the report", "run"] }],
    explain: ["Explain", "Why a run left its envelope, with remedies that are tried.", { run: "folder" }],
    compare: ["Compare", "All schemes side by side.", { scenario: "scenario", schemes: ["schemes, with commas", "cftsmppc,computed_torque,slotine_li"], out: ["folder of the report", "comparison"] }],
    study: ["Study", "Many cases: how likely, the worst, what matters.",
      { file: /\.ya?ml$/i, runs: ["runs, else the file's", ""], seed: ["seed, else the file's", ""], out: ["folder of the rows and the report", "study"], resume: false }],
    design: ["Design", "From requirements to the numbers of a law, or why there is none.",
      { requirements: SOME, runs: ["random cases of the check", 64], out: ["file of the scenario", "designed.yaml"] }],
    excite: ["Excite", "A motion that shows the arm's numbers best.", { robot: "robot", seed: ["seed", 1], out: ["file of the motion", "motion.csv"] }],
    identify: ["Identify", "Rotors, friction and payload from a log.",
      { log: /\.(csv|parquet|mcap|jsonl?)$/i, robot: "robot", out: ["file of the arm", "arm.yaml"], report: ["folder of the report", "identification"] }],
    "export-c": ["Export C", "The law as a C99 project.", { scenario: "scenario", out: ["folder of the project", "law"], float: false }],
    "export-web": ["Export a page", "A playground of this scenario as one file.", { scenario: "scenario", with: ["laws beside it, with commas", "printed,computed_torque"], out: ["folder of the page", "site"] }],
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

    function control(name, said) {
      const id = `studio-job-${name}`;
      if (said === false) return element("input", { id, name, type: "checkbox" });
      if (Array.isArray(said)) {
        const number = typeof said[1] === "number" || name === "runs" || name === "seed";
        return element("input", { id, name, type: number ? "number" : "text", value: said[1], autocomplete: "off" });
      }
      const folders = [...new Set(lists.names.filter(one => one.endsWith("log.parquet")).map(one => one.slice(0, -12)))];
      const options = said === "scenario" ? [...lists.builtIn, ...lists.names.filter(one => SOME.test(one))]
        : said === "robot" ? [...lists.robots, ...lists.names.filter(one => /\.(urdf|xml|mjcf)$/i.test(one))]
          : said === "folder" ? [...folders, ...lists.names.filter(one => one.endsWith(".mcap"))]
            : lists.names.filter(one => said.test(one));
      return element("select", { id, name }, options.map(text => element("option", { value: text, text })));
    }

    /* What was chosen of the same kind stays. */
    function fill() {
      const [, meaning, fields] = KINDS[kind.value];
      const before = Object.fromEntries([...form.querySelectorAll("[name]")].map(one => [one.name, one.type === "checkbox" ? one.checked : one.value]));
      const same = form.dataset.kind === kind.value;
      form.dataset.kind = kind.value;
      form.replaceChildren(element("p.studio-meaning", { text: meaning }), ...Object.entries(fields).map(([name, said]) => {
        const made = control(name, said);
        const known = made.tagName === "SELECT" && [...made.options].map(one => one.value);
        if (known && known.includes(before[name] ?? lists.opened)) made.value = before[name] ?? lists.opened;
        else if (!known && same && name in before) made[made.type === "checkbox" ? "checked" : "value"] = before[name];
        return element("p.studio-field", {}, element("label", { for: made.id, text: Array.isArray(said) ? said[0] : name }), made);
      }));
    }

    function said() {
      const found = {};
      for (const one of form.querySelectorAll("[name]")) {
        if (one.type === "checkbox") { if (one.checked) found[one.name] = true; }
        else if (one.value !== "") found[one.name] = one.type === "number" ? Number(one.value) : one.value.trim();
      }
      return found;
    }

    async function start() {
      const asked = { kind: kind.value, said: said() };
      let job;
      try {
        job = await values("POST", "/api/jobs", { json: asked });
      } catch (error) {
        if (!error.exists || !confirm(`${error.message}. Write over it?`)) throw error;
        job = await values("POST", "/api/jobs", { json: { ...asked, said: { ...asked.said, replace: true } } });
      }
      say(`${job.command} was started.`, "good");
      await renew();
    }

    /* Asks again while something runs. */
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
      element("div.studio-row", {}, element("p.studio-field", {}, element("label", { for: kind.id, text: "What" }), kind)),
      form,
      element("div.studio-row", {}, button("Start", say, start, "button primary")),
      line, list);
    /* The scenario that was opened last is what jobs are first offered for. */
    function opened(name) {
      lists = { ...lists, opened: name };
      const control = form.querySelector("[name=scenario]");
      if (control && [...control.options].some(one => one.value === name)) control.value = name;
    }

    return { panel, renew, say, opened, list(found) { lists = { ...found, opened: lists.opened }; fill(); } };
  };
})();
