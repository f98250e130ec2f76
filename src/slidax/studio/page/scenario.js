/* The panel with the scenario as text: opened, checked, run by the page, saved, made for a new arm. */
"use strict";

(() => {
  const { values, element, button, lineOf } = studioParts;

  /* - `page`: of the playground.
     - `files`: the names of the folder, again when they changed. */
  studioParts.scenarioPanel = ({ page, files, about, opened }) => {
    const [line, say] = lineOf();
    const state = { name: about.opened.endsWith(".yaml") || about.opened.endsWith(".yml") ? "" : about.opened,
      path: "", mark: null, clean: "" };
    const choice = element("select", { id: "studio-scenario" });
    const text = element("textarea", { id: "studio-text", rows: "18", spellcheck: "false", wrap: "off",
      "aria-label": "The scenario as YAML" });
    const path = element("input", { id: "studio-path", type: "text", value: "scenario.yaml", autocomplete: "off" });
    const robot = element("select", { id: "studio-robot" });
    const rate = element("input", { id: "studio-rate", type: "number", min: "20", max: "20000", value: "1000" });
    const file = element("input", { id: "studio-upload", type: "file", accept: ".urdf,.xml,.mjcf,.yaml,.yml,.csv,.json,.jsonl,.parquet,.mcap" });

    const source = () => (text.value === state.clean && state.name ? { name: state.name }
      : { text: text.value, path: path.value });

    function shown(made, name, at, mark) {
      Object.assign(state, { name, path: at, mark, clean: made });
      text.value = made;
      path.value = at || (name ? `${name}.yaml` : "scenario.yaml");
    }

    /* - `plays`: whether the playground shows it, too. */
    async function open(what, plays = true) {
      say("opening ...");
      if (/\.ya?ml$/i.test(what)) {
        const found = await values("GET", `/api/file?path=${encodeURIComponent(what)}`);
        shown(found.text, "", what, found.mark);
      } else {
        const found = await values("POST", "/api/check", { json: { name: what } });
        shown(found.text, what, "", null);
      }
      choice.value = what;
      opened(what);
      if (plays) await play();
      await check();
    }

    async function check() {
      const found = await values("POST", "/api/check", { json: source() });
      const notes = [...found.warnings, ...found.beforehand];
      const about = `${found.title || found.scenario}: ${found.scheme} on ${found.robot}, ${found.joints} joints, `
        + `${found.t1} s at ${+(1 / found.period).toPrecision(4)} Hz`;
      say([`${about}.`, ...notes].join(" "), notes.length ? "warn" : "good");
      return found;
    }

    /* The playground shows this scenario, with its sliders. */
    async function play() {
      say("making the playground of it ...");
      const found = await values("POST", "/api/manifest", { json: source() });
      // What the address says is of the playground before.
      history.replaceState(null, "", location.pathname);
      page()?.load(found.manifest);
      say(`The playground shows ${found.title || found.scenario}.`, "good");
    }

    /* The same in the page itself: no slider then waits for the server. What was moved stays. */
    async function compile() {
      const was = page()?.manifest;
      say("compiling it for this page; it can be used meanwhile ...");
      const found = await values("POST", "/api/compiled", { json: source(), headers: { "x-slidax-slot": "compile" } });
      if (page()?.manifest !== was) return say("another scenario was opened meanwhile", "warn");
      page()?.load(found.manifest);
      say("The sliders of this law now run in the page itself.", "good");
    }

    async function save() {
      const named = path.value.trim();
      const mark = named === state.path ? state.mark : null;
      let saved;
      try {
        saved = await put(named, text.value, mark);
      } catch (error) {
        if (!error.exists || !confirm(`${named} is there already, or was changed elsewhere. Write over it?`)) throw error;
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

    /* What the sliders say, as text: so that it can be saved, or be the start of a job. */
    function taken() {
      const made = page()?.scenarioText?.();
      if (!made) return say("the playground has no scenario yet", "warn");
      text.value = made;
      state.name = "";
      say("The text is what the sliders say.", "good");
    }

    async function draft() {
      say("making a scenario for it ...");
      const found = await values("POST", "/api/new", { json: { robot: robot.value, rate: Number(rate.value) } });
      const stem = robot.value.split("/").pop().replace(/\.[^.]*$/, "");
      shown(found.text, "", "", null);
      path.value = `${stem}.yaml`;
      say(["A scenario that runs; save it, or play it.", ...found.notes].join(" "), found.notes.length ? "warn" : "good");
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
      robot.replaceChildren(group("ready", robots), group("in the folder", names.filter(name => /\.(urdf|xml|mjcf)$/i.test(name))));
      if (before[0]) choice.value = before[0];
      if (before[1]) robot.value = before[1];
    }

    choice.addEventListener("change", () => open(choice.value).catch(error => say(error.message, "bad")));
    const field = (label, control, ...more) => element("p.studio-field", {},
      element("label", { for: control.id, text: label }), control, more);
    const panel = element("div.studio-panel", {},
      element("div.studio-row", {},
        field("Scenario", choice),
        button("Play it", say, play, "button primary"),
        button("Make its sliders instant", say, compile),
        button("Check", say, check),
        button("Take the sliders' values", say, async () => taken())),
      line,
      text,
      element("div.studio-row", {}, field("File", path), button("Save", say, save)),
      element("div.studio-row", {}, field("New, for the arm", robot), field("at [Hz]", rate), button("Make a scenario", say, draft)),
      element("div.studio-row", {}, field("Bring a file (URDF, MJCF, YAML, a log)", file), button("Bring it", say, upload)));
    return { panel, list, open, check, say, choice, source };
  };
})();
