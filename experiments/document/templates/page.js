// Folds that open where a link leads, and tables that are sorted by a press on a head.

function unfold(anchor) {
  const target = anchor && document.getElementById(decodeURIComponent(anchor));
  for (let each = target; each; each = each.parentElement) if (each.tagName === "DETAILS") each.open = true;
  return target;
}

// Without the page that this one may be a frame of, which browsers move for anchors that they know: those without a tilde.
function unfoldHash() {
  const target = unfold(location.hash.replace(/^#~?/, ""));
  if (target) window.scrollTo(0, target.getBoundingClientRect().top + window.scrollY);
}

window.addEventListener("hashchange", unfoldHash);
document.querySelectorAll('a[href^="#"]').forEach((link) => link.addEventListener("click", () => setTimeout(unfoldHash)));
unfoldHash();

let unfolded = [];
window.addEventListener("beforeprint", () => {
  unfolded = [...document.querySelectorAll("main details:not([open])")];
  unfolded.forEach((each) => (each.open = true));
});
window.addEventListener("afterprint", () => unfolded.forEach((each) => (each.open = false)));

// A number as it is shown, or else the text.
function keyOf(row, column) {
  const text = row.cells[column] ? row.cells[column].textContent.trim().replace("\u2212", "-") : "";
  const number = parseFloat(text);
  return Number.isNaN(number) ? text : number;
}

function compare(a, b) {
  if (typeof a === typeof b) return typeof a === "number" ? a - b : a.localeCompare(b);
  return typeof a === "number" ? -1 : 1;
}

// First up, then down, then as it was; rows stay in their group.
function sort(table, head, column) {
  const next = { none: "ascending", ascending: "descending", descending: "none" }[head.ariaSort || "none"];
  table.querySelectorAll("thead th").forEach((each) => (each.ariaSort = each === head ? next : "none"));
  for (const body of table.tBodies) {
    const rows = [...body.rows].filter((row) => row.dataset.row);
    const sign = next === "descending" ? -1 : 1;
    const order = (a, b) => (next === "none" ? a.dataset.row - b.dataset.row : sign * compare(keyOf(a, column), keyOf(b, column)));
    body.append(...rows.sort(order));
  }
}

document.querySelectorAll("table[data-table]").forEach((table) => {
  [...table.tHead.rows[0].cells].forEach((head, column) => {
    const press = document.createElement("button");
    Object.assign(press, { className: "plain", type: "button" });
    press.append(...head.childNodes);
    press.addEventListener("click", () => sort(table, head, column));
    head.append(press);
  });
});
