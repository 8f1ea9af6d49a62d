// Elements, numbers as text, sortable tables. Text from records goes into text nodes only.

const NONE = "–";

/** An element with attributes, and children that are elements or text. */
function make(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (name === "class") made.className = value;
    else if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

const byId = (id) => document.getElementById(id);
const decimals = (value, places) => (value === null || value === undefined ? NONE : value.toFixed(places));
const percent = (value, places = 2) => (value === null || value === undefined ? NONE : `${(100 * value).toFixed(places)} %`);
const whole = (value) => (value === null || value === undefined ? NONE : value.toLocaleString("en-US"));
const unique = (values) => [...new Set(values)].sort();

/** A name that may break after its punctuation, not within a word. */
const named = (name) => make("span", { class: "name" }, ...name.split(/(?<=[+:,=])/).flatMap((part, k) => (k ? [make("wbr"), part] : [part])));
const counted = (text) => text.replaceAll("<=", "≤");

/** A box that scrolls sideways, by keyboard too. */
const scroller = (name, child) => make("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": name }, child);

/**
 * A table whose headings sort it.
 * columns: {label, title, text(row): string or element, value(row): what it sorts by, numeric}
 */
class SortedTable {
  constructor(name, columns) {
    this.columns = columns;
    this.order = null;
    this.body = make("tbody");
    this.heads = columns.map((column, k) =>
      make("th", { scope: "col", class: column.numeric ? "number" : null, "aria-sort": "none" },
        make("button", { type: "button", title: column.title, onclick: () => this.sort(k) }, column.label, make("span", { class: "arrow", "aria-hidden": "true" }))));
    this.root = scroller(name, make("table", {}, make("caption", { class: "quiet" }, name), make("thead", {}, make("tr", {}, ...this.heads)), this.body));
    this.rows = [];
  }

  show(rows) {
    this.rows = rows;
    this.draw();
  }

  sort(k) {
    // First the better end: numbers from the largest, names from A; then the other way; then as ranked.
    const first = this.columns[k].numeric ? -1 : 1;
    if (!this.order || this.order.k !== k) this.order = { k, way: first };
    else if (this.order.way === first) this.order.way = -first;
    else this.order = null;
    this.draw();
  }

  draw() {
    const rows = [...this.rows];
    if (this.order) {
      const { k, way } = this.order, value = this.columns[k].value;
      rows.sort((one, other) => {
        const a = value(one), b = value(other);
        if (a === null || a === undefined) return b === null || b === undefined ? 0 : 1;
        if (b === null || b === undefined) return -1;
        return way * (typeof a === "number" ? a - b : String(a).localeCompare(String(b), "en", { numeric: true }));
      });
    }
    this.heads.forEach((head, k) => {
      const way = this.order && this.order.k === k ? this.order.way : 0;
      head.setAttribute("aria-sort", way === 0 ? "none" : way > 0 ? "ascending" : "descending");
      head.querySelector(".arrow").textContent = way === 0 ? "" : way > 0 ? " ▲" : " ▼";
    });
    this.body.replaceChildren(...rows.map((row) => this.line(row)));
  }

  line(row) {
    const cells = this.columns.map((column, k) =>
      make(k ? "td" : "th", { class: column.numeric ? "number" : null, scope: k ? null : "row" }, column.text(row)));
    return make("tr", {}, ...cells);
  }
}
