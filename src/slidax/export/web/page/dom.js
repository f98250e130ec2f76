/* Construction of HTML elements in one expression. */

/* - `tag`: name of the element, with classes after dots.
   - `given`: attributes; `on` has event listeners, `text` is the text; an attribute that is false or null is left out.
   - `children`: nodes and texts. */
export function element(tag, given = {}, ...children) {
  const [name, ...classes] = tag.split(".");
  const made = document.createElement(name);
  if (classes.length) made.className = classes.join(" ");
  for (const [key, value] of Object.entries(given)) {
    if (value === false || value === null || value === undefined) continue;
    if (key === "on") for (const [event, listener] of Object.entries(value)) made.addEventListener(event, listener);
    else if (key === "text") made.textContent = value;
    else made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children.flat().filter(child => child !== null && child !== undefined));
  return made;
}

export function byId(id) {
  return document.getElementById(id);
}

/* A table with a head; the first cell of each row is its title. A table that is too wide scrolls, also by keyboard. */
export function tableOf(caption, head, rows) {
  const heads = head.map(text => element("th", { scope: "col", text }));
  const body = rows.map(([first, ...cells]) =>
    element("tr", {}, element("th", { scope: "row", text: first }), cells.map(text => element("td", { text }))));
  const table = element("table", {}, element("caption", { text: caption }),
    element("thead", {}, element("tr", {}, heads)), element("tbody", {}, body));
  return element("div.wide", { tabindex: "0", role: "region", "aria-label": caption }, table);
}
