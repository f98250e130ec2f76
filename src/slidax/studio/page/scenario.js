/* The panel of the scenario as text: open, check, simulate, save, and create for a new arm. */
"use strict";

(() => {
  const { values, element, button, lineOf } = studioParts;

  /* - `page`: returns the playground's page.
     - `files`: the folder's files; `renew` reads them again. */
  studioParts.scenarioPanel = ({ page, files, about, opened }) => {
    const [line, say] = lineOf();
    const state = { name: about.opened.endsWith(".yaml") || about.opened.endsWith(".yml") ? "" : about.opened,
      path: "", mark: null, clean: "" };
    const choice = element("select", { id: "studio-scenario" });
    const text = element("textarea", { id: "studio-text", rows: "18", spellcheck: "false", wrap: "off",
      "aria-label": "Scenario as YAML" });
    const path = element("input", { id: "studio-path", type: "text", value: "scenario.yaml", autocomplete: "off" });
    const robot = element("select", { id: "studio-robot" });
    const rate = element("input", { id: "studio-rate", type: "number", min: "20", max: "20000", value: "1000" });
    const file = element("input", { id: "studio-upload", type: "file", accept: ".urdf,.xml,.mjcf,.yaml,.yml,.csv,.json,.jsonl,.parquet,.mcap" });

    const source = () => (text.value === state.clean && state.name ? { name: state.name }
      : { text: text.value, path: path.value });

    function show(content, name, at, mark) {
      Object.assign(state, { name, path: at, mark, clean: content });
      text.value = content;
      path.value = at || (name ? `${name}.yaml` : "scenario.yaml");
    }

    /* - `plays`: also load it into the playground. */
    async function open(what, plays = true) {
      say("opening ...");
      if (/\.ya?ml$/i.test(what)) {
        const reply = await values("GET", `/api/file?path=${encodeURIComponent(what)}`);
        show(reply.text, "", what, reply.mark);
      } else {
        const reply = await values("POST", "/api/check", { json: { name: what } });
        show(reply.text, what, "", null);
      }
      choice.value = what;
      opened(what);
      if (plays) await play();
      await check();
    }

    async function check() {
      const reply = await values("POST", "/api/check", { json: source() });
      const notes = [...reply.warnings, ...reply.beforehand];
      const about = `${reply.title || reply.scenario}: ${reply.scheme} on ${reply.robot}, ${reply.joints} joints, `
        + `${reply.t1} s at ${+(1 / reply.period).toPrecision(4)} Hz`;
      say([`${about}.`, ...notes].join(" "), notes.length ? "warn" : "good");
      return reply;
    }

    /* Load this scenario into the playground. */
    async function play() {
      say("loading the playground ...");
      const reply = await values("POST", "/api/manifest", { json: source() });
      // The address still describes the previous playground.
      history.replaceState(null, "", location.pathname);
      page()?.load(reply.manifest);
      say(`The playground shows ${reply.title || reply.scenario}.`, "good");
    }

    /* Compile the scenario for the page, so that sliders do not wait for the server; moved sliders stay. */
    async function compile() {
      const was = page()?.manifest;
      say("compiling for this page; you can go on working ...");
      const reply = await values("POST", "/api/compiled", { json: source(), headers: { "x-slidax-slot": "compile" } });
      if (page()?.manifest !== was) return say("another scenario was opened in the meantime", "warn");
      page()?.load(reply.manifest);
      say("The sliders of this law now run in the page itself.", "good");
    }

    async function save() {
      const named = path.value.trim();
      const mark = named === state.path ? state.mark : null;
      let saved;
      try {
        saved = await put(named, text.value, mark);
      } catch (error) {
        if (!error.exists || !confirm(`${named} exists already, or was changed elsewhere. Overwrite?`)) throw error;
        const now = await values("GET", `/api/file?path=${encodeURIComponent(named)}`);
        saved = await put(named, text.value, now.mark);
      }
      Object.assign(state, { name: "", path: named, mark: saved.mark, clean: text.value });
      say(`${named} is saved.`, "good");
      await files.renew();
    }

    function put(named, body, mark) {
      return values("PUT", `/api/file?path=${encodeURIComponent(named)}`,
        { body, headers: mark ? { "if-match": mark } : {} });
    }

    /* Copy the sliders' values into the text, to save it or to start a job. */
    function taken() {
      const content = page()?.scenarioText?.();
      if (!content) return say("the playground has no scenario yet", "warn");
      text.value = content;
      state.name = "";
      say("The text has the sliders' values.", "good");
    }

    async function draft() {
      say("creating a scenario ...");
      const reply = await values("POST", "/api/new", { json: { robot: robot.value, rate: Number(rate.value) } });
      const stem = robot.value.split("/").pop().replace(/\.[^.]*$/, "");
      show(reply.text, "", "", null);
      path.value = `${stem}.yaml`;
      say(["This scenario runs: save it, or simulate it.", ...reply.notes].join(" "), reply.notes.length ? "warn" : "good");
    }

    async function upload() {
      const [chosen] = file.files;
      if (!chosen) return say("choose a file first", "warn");
      await put(chosen.name, chosen, null);
      await files.renew();
      say(`${chosen.name} is in the folder.`, "good");
    }

    function list({ names, builtIn, robots }) {
      const option = value => element("option", { value, text: value });
      const group = (label, entries) => element("optgroup", { label }, entries.map(option));
      const before = [choice.value, robot.value];
      choice.replaceChildren(group("built in", builtIn), group("in the folder", names.filter(name => /\.ya?ml$/i.test(name))));
      robot.replaceChildren(group("built in", robots), group("in the folder", names.filter(name => /\.(urdf|xml|mjcf)$/i.test(name))));
      if (before[0]) choice.value = before[0];
      if (before[1]) robot.value = before[1];
    }

    choice.addEventListener("change", () => open(choice.value).catch(error => say(error.message, "bad")));
    const field = (label, control, ...more) => element("p.studio-field", {},
      element("label", { for: control.id, text: label }), control, more);
    const panel = element("div.studio-panel", {},
      element("div.studio-row", {},
        field("Scenario", choice),
        button("Simulate", say, play, "button primary"),
        button("Compile for this page", say, compile),
        button("Check", say, check),
        button("Copy slider values", say, async () => taken())),
      line,
      text,
      element("div.studio-row", {}, field("File", path), button("Save", say, save)),
      element("div.studio-row", {}, field("New scenario for", robot), field("at [Hz]", rate), button("Create", say, draft)),
      element("div.studio-row", {}, field("Upload a file (URDF, MJCF, YAML, log)", file), button("Upload", say, upload)));
    return { panel, list, open, check, say, choice, source };
  };
})();
