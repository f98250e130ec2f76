/* The studio's panels in the playground's page, and runs by the server for scenarios that are not compiled. */
"use strict";

(() => {
  const { values, run, element } = studioParts;
  const place = () => document.getElementById("studio");
  const page = () => globalThis.slidaxPage;

  /* Tabs with one tab stop, and arrow keys between them. */
  function tabs(entries) {
    const heads = entries.map(([id, title], k) => element("button.studio-tab", { type: "button", role: "tab",
      id: `studio-tab-${id}`, "aria-controls": `studio-panel-${id}`, text: title, tabindex: k ? "-1" : "0" }));
    const panels = entries.map(([id, , panel]) => {
      panel.id = `studio-panel-${id}`;
      panel.setAttribute("role", "tabpanel");
      panel.setAttribute("aria-labelledby", `studio-tab-${id}`);
      return panel;
    });
    const choose = (chosen, focus) => heads.forEach((head, k) => {
      head.setAttribute("aria-selected", String(k === chosen));
      head.tabIndex = k === chosen ? 0 : -1;
      panels[k].hidden = k !== chosen;
      if (k === chosen && focus) head.focus();
    });
    heads.forEach((head, k) => {
      head.addEventListener("click", () => choose(k));
      head.addEventListener("keydown", ({ key }) => {
        const step = { ArrowRight: 1, ArrowLeft: -1 }[key];
        if (step) choose((k + step + heads.length) % heads.length, true);
      });
    });
    choose(0);
    return [element("div.studio-tabs", { role: "tablist", "aria-label": "Studio" }, heads), ...panels];
  }

  async function begin() {
    const home = place();
    const title = element("h2", { text: "Studio" });
    try {
      const about = await values("GET", "/api/about");
      const { catalogue } = await values("POST", "/api/catalogue", { json: {} });
      const users = [];
      const files = {
        async renew() {
          const names = (await values("GET", "/api/files")).files;
          const lists = { names: names.map(one => one.name), builtIn: Object.keys(catalogue.scenarios),
            robots: Object.keys(catalogue.robots).filter(one => !["two_link", "scara", "urdf", "mjcf", "identified"].includes(one)),
            entries: names };
          users.forEach(user => user.list(lists));
        },
      };
      const jobs = studioParts.jobsPanel({ about, files });
      const scenario = studioParts.scenarioPanel({ page, files, about, opened: jobs.opened });
      const shelf = studioParts.filesPanel({ files, open: scenario.open });
      users.push(scenario, jobs, shelf);
      home.replaceChildren(title, element("p.studio-soft", { text: `slidax ${about.version}, in the folder “${about.folder}”. It reads and writes nothing outside.` }),
        ...tabs([["scenario", "Scenario", scenario.panel], ["jobs", "Jobs", jobs.panel], ["files", "Files", shelf.panel]]));
      home.hidden = false;
      document.querySelector("header .theme")?.before(element("button.button.studio-jump", { type: "button", text: "Studio", title: "Files, scenario as text, jobs",
        on: { click: () => { home.scrollIntoView(); home.querySelector("[role=tab]").focus({ preventScroll: true }); } } }));
      await files.renew();
      await jobs.renew();
      // The page starts with a built-in scenario; the user's own needs the token.
      const first = about.opened || about.shown;
      scenario.choice.value = first;
      await scenario.open(first, first !== about.shown).catch(error => scenario.say(error.message, "bad"));
    } catch (error) {
      home.replaceChildren(title, element("p.studio-line", { role: "alert", "data-tone": "bad", text: error.message }));
      home.hidden = false;
    }
  }

  globalThis.slidaxStudio = {
    ready: begin,
    /* File names are relative to the studio's folder. A run that a newer one replaces returns null. */
    async run({ scenario, side }) {
      try {
        return await run({ text: JSON.stringify(scenario), path: "playground.yaml" }, side);
      } catch (error) {
        if (error.status === 409) return null;
        throw error;
      }
    },
  };
})();
