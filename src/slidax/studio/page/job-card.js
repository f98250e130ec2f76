/* One job: how far it is, what it said, what it wrote. */
"use strict";

(() => {
  const { values, element, button } = studioParts;

  studioParts.jobCard = (id, { renew, say }) => {
    const head = element("p.studio-job-head");
    const bar = element("progress", { hidden: true, "aria-label": "rows that are done" });
    const detail = element("div.studio-answer");
    const log = element("pre", { tabindex: "0", "aria-label": "What it said" });
    const more = element("details", {}, element("summary", { text: "What it said" }), log);
    const end = button("Cancel", say, async () => {
      await values("DELETE", `/api/jobs/${id}`);
      await renew();
    });
    const place = element("li.studio-job", {}, head, bar, detail, more, end);
    let last = "";

    /* True when it has just ended. */
    async function show(job) {
      const over = job.state !== "waiting" && job.state !== "running";
      const state = over && job.meaning ? `${job.state}: ${job.meaning}` : job.state;
      head.replaceChildren(element("span.chip", { text: state, "data-state": job.state === "done" && job.code ? "doubt" : job.state }),
        element("code", { text: job.command }), ` ${job.seconds.toFixed(1)} s`);
      bar.hidden = over || !job.rows;
      if (job.rows) [bar.value, bar.max] = job.rows;
      end.textContent = over ? "Forget" : "Cancel";
      if (last === job.state && (over || !more.open)) return false;
      const whole = await values("GET", `/api/jobs/${id}`);
      log.textContent = whole.log || "nothing";
      const ended = over && last !== job.state && last !== "";
      if (over) detail.replaceChildren(...answered(whole));
      last = job.state;
      return ended;
    }

    more.addEventListener("toggle", () => renew().catch(error => say(error.message, "bad")));
    return { place, show };
  };

  function answered({ kind, answer, links, state, log }) {
    const made = [];
    if (state === "failed") made.push(element("p", { text: log.trim().split("\n").pop() || "It ended without a word." }));
    if (answer && typeof answer === "object") made.push(kind === "certify" || answer.certificates ? lights(answer) : rows(answer));
    else if (answer && state === "done") made.push(element("pre", { tabindex: "0", text: answer, "aria-label": "What it found" }));
    if (links.length) {
      made.push(element("ul.studio-links", {}, links.map(({ name, at }) => element("li", {},
        element("a", { href: at, target: "_blank", rel: "noopener noreferrer", text: name })))));
    }
    return made;
  }

  function lights({ certificates = [], ...others }) {
    const word = { true: "holds", false: "does not hold", null: "does not apply" };
    return element("div", {}, rows(others), element("ul.studio-lights", {}, certificates.map(one => element("li", {},
      element("span.chip", { text: (word[String(one.holds)] ?? "") + (one.since ? ` from ${Number(one.since.toPrecision(3))} s on` : ""), "data-holds": String(one.holds) }),
      element("strong", { text: one.grade ? `${one.name}, grade ${one.grade}` : one.name }), ` ${one.statement ?? ""}`,
      one.holds === false && one.remedy ? element("em", { text: ` ${one.remedy}` }) : null))));
  }

  /* What is one value, in a table; lists and mappings as JSON, shut. */
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
      Object.keys(deep).length ? element("details", {}, element("summary", { text: "All numbers" }),
        element("pre", { tabindex: "0", "aria-label": "All numbers", text: JSON.stringify(deep, null, 1) })) : null);
  }
})();
