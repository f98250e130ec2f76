// A figure that is hardly wider than a phone is fitted to it, and does not scroll.
const fit = (image) => image.classList.toggle("narrow", image.naturalWidth < 430);
// A cell of some words has a class, so that no table makes it as narrow as its longest word; a short one stays in a line.
// Tables and figures that scroll can be reached by the keyboard, and the bars of buttons beside code have names.
const reachable = () => {
  for (const wrap of document.querySelectorAll(".md-typeset__scrollwrap")) {
    wrap.tabIndex = 0;
    wrap.setAttribute("role", "group");
    wrap.setAttribute("aria-label", "table");
  }
  for (const image of document.querySelectorAll('.md-typeset p > img[src$=".svg"]')) {
    image.parentElement.tabIndex = 0;
    if (image.complete) fit(image);
    else image.onload = () => fit(image);
  }
  for (const cell of document.querySelectorAll(".md-typeset td")) {
    cell.classList.toggle("sentence", cell.textContent.length > 24);
    cell.classList.toggle("short", cell.textContent.length <= 10);
  }
  document.querySelectorAll(".md-code__nav").forEach((bar, i) => bar.setAttribute("aria-label", `code block ${i + 1}`));
};
// The theme wraps tables, and adds the bars, after the page has loaded.
new MutationObserver(reachable).observe(document.documentElement, { childList: true, subtree: true });
reachable();
