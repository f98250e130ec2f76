/* The panel of the folder's files. */
"use strict";

(() => {
  const { values, element, button, lineOf } = studioParts;

  studioParts.filesPanel = ({ files, open }) => {
    const [line, say] = lineOf();
    const body = element("tbody");
    const shown = element("pre.studio-file", { tabindex: "0", hidden: true, "aria-label": "File content" });

    async function look(name) {
      const file = await values("GET", `/api/file?path=${encodeURIComponent(name)}`);
      shown.textContent = file.text;
      shown.hidden = false;
      say(name);
    }

    function size(bytes) {
      return bytes < 1e3 ? `${bytes} B` : bytes < 1e6 ? `${(bytes / 1e3).toFixed(1)} kB` : `${(bytes / 1e6).toFixed(1)} MB`;
    }

    const readable = /\.(ya?ml|json|jsonl|csv|md|c|h|txt|urdf|xml|mjcf|svg)$/i;
    const row = ({ name, size: bytes, changed }) => element("tr", {},
      element("th", { scope: "row", text: name }),
      element("td", { text: size(bytes) }),
      element("td", { text: new Date(1000 * changed).toLocaleString() }),
      element("td", {},
        readable.test(name) ? button("View", say, () => look(name)) : null,
        /\.ya?ml$/i.test(name) ? button("Open as scenario", say, () => open(name)) : null));

    const panel = element("div.studio-panel", {},
      element("div.studio-row", {}, button("Refresh", say, files.renew)),
      line, shown,
      element("div.studio-wide", { tabindex: "0", role: "region", "aria-label": "Files" },
        element("table", {}, element("caption", { text: "Files in the folder" }),
          element("thead", {}, element("tr", {}, ["Name", "Size", "Changed", "Actions"].map(text => element("th", { scope: "col", text })))), body)));
    return { panel, say, list({ entries }) { body.replaceChildren(...(entries.length ? entries.map(row) : [element("tr", {}, element("td", { colspan: "4", text: "No files yet" }))])); } };
  };
})();
