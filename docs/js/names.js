// Names for what the theme leaves without one, for readers who hear the page, and keys for code that scrolls.
document.addEventListener("DOMContentLoaded", () => {
  document.querySelector(".md-search").setAttribute("aria-label", "Search");
  setTimeout(() => {
    document.querySelectorAll(".md-code__nav").forEach((each, k) => each.setAttribute("aria-label", `Code ${k + 1}`));
    document.querySelectorAll("pre > code, .md-typeset__scrollwrap").forEach((each) => (each.tabIndex = 0));
  });
});
