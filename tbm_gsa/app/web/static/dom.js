// Small helpers: elements, numbers and times in words.

export const byId = (id) => document.getElementById(id);

// Element with attributes and children; texts are texts, never markup.
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== undefined && child !== null));
  return made;
}

export function svg(name, attributes = {}, ...children) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

// Set a text only where it has changed: a live region is read out again otherwise.
export function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

const UP = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };
export const power = (exponent) => `10${[...String(exponent)].map((digit) => UP[digit]).join("")}`;

// A number to so many digits; a dash for what is not known.
export function number(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value !== 0 && (Math.abs(value) < 1e-3 || Math.abs(value) >= 1e5)) {
    const exponent = Math.floor(Math.log10(Math.abs(value)));
    return `${(value / 10 ** exponent).toPrecision(digits - 1)}·${power(exponent)}`;
  }
  return String(Number(value.toPrecision(digits)));
}

// A time of day, with its date where that is another day.
export function moment(text) {
  const time = new Date(text);
  const today = time.toDateString() === new Date().toDateString();
  const day = today ? {} : { day: "numeric", month: "short" };
  const year = time.getFullYear() === new Date().getFullYear() ? {} : { year: "numeric" };
  return time.toLocaleString("en-GB", { ...day, ...(today ? {} : year), hour: "2-digit", minute: "2-digit" });
}

export function ago(text) {
  const minutes = Math.floor((Date.now() - new Date(text)) / 60000);
  if (minutes < 1) return "just now";
  if (minutes < 120) return `${minutes} min ago`;
  return minutes < 2880 ? `${Math.floor(minutes / 60)} h ago` : `${Math.floor(minutes / 1440)} days ago`;
}

// Rows of a table's body, made anew.
export function fill(table, rows) {
  table.tBodies[0].replaceChildren(...rows);
}

export function cells(...contents) {
  return contents.map((content) => (content instanceof HTMLTableCellElement ? content : element("td", {}, content)));
}

export function table(head, rows) {
  const cellsOf = (names) => names.map((name) => element("th", { scope: "col" }, name));
  const body = rows.map(([first, ...others]) => element("tr", {}, element("th", { scope: "row" }, first), ...cells(...others)));
  return element("table", {}, element("thead", {}, element("tr", {}, ...cellsOf(head))), element("tbody", {}, ...body));
}
