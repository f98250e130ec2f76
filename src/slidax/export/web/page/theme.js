/* Dark and light theme, and the colours of the style sheet for canvases. */

const THEMES = ["auto", "light", "dark"];
const KEPT_THEME = "slidax-theme";
let knownColours = new Map();

export function colourOf(name) {
  if (!knownColours.has(name)) knownColours.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return knownColours.get(name);
}

/* Red, green, blue and opacity, each 0 to 1, of a colour written as #rrggbb or #rrggbbaa. */
export function colourParts(name) {
  const digits = colourOf(name).slice(1);
  const part = k => parseInt(digits.slice(2 * k, 2 * k + 2), 16) / 255;
  return [part(0), part(1), part(2), digits.length > 6 ? part(3) : 1];
}

/* - `changed`: called after the colours have changed. */
export function followTheme(select, changed) {
  const put = theme => {
    document.documentElement.dataset.theme = theme;
    knownColours = new Map();
    changed();
  };
  let kept = null;
  try {
    kept = localStorage.getItem(KEPT_THEME);
  } catch {
    /* A page that is opened from a file may have no storage. */
  }
  select.value = THEMES.includes(kept) ? kept : "auto";
  put(select.value);
  select.addEventListener("change", () => {
    try {
      localStorage.setItem(KEPT_THEME, select.value);
    } catch {
      /* Without storage the theme is not kept. */
    }
    put(select.value);
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => put(select.value));
}

export function wantsStillness() {
  return matchMedia("(prefers-reduced-motion: reduce)").matches;
}
