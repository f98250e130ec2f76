/* One job: progress, log and results. */
"use strict";

(() => {
  const { values, element, button } = studioParts;

  studioParts.jobCard = (id, { renew, say }) => {
    const head = element("p.studio-job-head");
    const bar = element("progress", { hidden: true, "aria-label": "finished rows" });
    const detail = element("div.studio-answer");
    const log = element("pre", { tabindex: "0", "aria-label": "Log" });
    const more = element("details", {}, element("summary", { text: "Log" }), log);
    const end = button("Cancel", say, async () => {
      await values("DELETE", `/api/jobs/${id}`);
      await renew();
    });
    const place = element("li.studio-job", {}, head, bar, detail, more, end);
    let last = "";

    /* Return true if the job has just ended. */
    async function show(job) {
      const over = job.state !== "waiting" && job.state !== "running";
      const state = over && job.meaning && job.meaning !== job.state ? `${job.state}: ${job.meaning}` : job.state;
      head.replaceChildren(element("span.chip", { text: state, "data-state": job.state === "done" && job.code ? "doubt" : job.state }),
        element("code", { text: job.command }), ` ${job.seconds.toFixed(1)} s`);
      bar.hidden = over || !job.rows;
      if (job.rows) [bar.value, bar.max] = job.rows;
      end.textContent = over ? "Remove" : "Cancel";
      if (last === job.state && (over || !more.open)) return false;
      const whole = await values("GET", `/api/jobs/${id}`);
      log.textContent = whole.log || "empty";
      const ended = over && last !== job.state && last !== "";
      if (over) detail.replaceChildren(...results(whole));
      last = job.state;
      return ended;
    }

    more.addEventListener("toggle", () => renew().catch(error => say(error.message, "bad")));
    return { place, show };
  };

  function results({ kind, answer, links, state, log }) {
    const nodes = [];
    if (state === "failed") nodes.push(element("p", { text: log.trim().split("\n").pop() || "The job failed without a message." }));
    if (answer && typeof answer === "object") nodes.push(kind === "certify" || answer.certificates ? lights(answer) : rows(answer));
    else if (answer && state === "done") nodes.push(element("pre", { tabindex: "0", text: answer, "aria-label": "Result" }));
    if (links.length) {
      nodes.push(element("ul.studio-links", {}, links.map(({ name, at }) => element("li", {},
        element("a", { href: at, target: "_blank", rel: "noopener noreferrer", text: name })))));
    }
    return nodes;
  }

  function lights({ certificates = [], ...others }) {
    const word = { true: "holds", false: "does not hold", null: "does not apply" };
    return element("div", {}, rows(others), element("ul.studio-lights", {}, certificates.map(certificate => element("li", {},
      element("span.chip", { text: (word[String(certificate.holds)] ?? "") + (certificate.since ? ` from ${Number(certificate.since.toPrecision(3))} s on` : ""), "data-holds": String(certificate.holds) }),
      element("strong", { text: certificate.grade ? `${certificate.name}, grade ${certificate.grade}` : certificate.name }), ` ${certificate.statement ?? ""}`,
      certificate.holds === false ? remedies(certificate.remedy ?? []) : null))));
  }

  /* Proposed changes, each with the settings that make it, as the command line takes them. */
  function remedies(all) {
    return all.map(({ words, set }) => {
      const settings = Object.entries(set).map(([path, value]) => `${path}=${JSON.stringify(value)}`);
      return element("p", {}, element("em", { text: words }), settings.length ? " " : null,
        settings.length ? element("code", { text: settings.join(" ") }) : null);
    });
  }

  /* Single values in a table; lists and mappings as collapsed JSON. */
  function rows(answer) {
    const flat = [], deep = {};
    for (const [key, value] of Object.entries(answer)) {
      if (value === null || value === undefined) continue;
      if (typeof value === "object") deep[key] = value;
      else flat.push([key, typeof value === "number" ? String(+value.toPrecision(5)) : String(value)]);
    }
    return element("div", {},
      flat.length ? element("table", {}, element("tbody", {}, flat.map(([key, value]) => element("tr", {},
        element("th", { scope: "row", text: key }), element("td", { text: value }))))) : null,
      Object.keys(deep).length ? element("details", {}, element("summary", { text: "All values" }),
        element("pre", { tabindex: "0", "aria-label": "All values", text: JSON.stringify(deep, null, 1) })) : null);
  }
})();
