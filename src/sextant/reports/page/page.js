// Tables are sorted by a click on a heading: numbers by what they begin with, other text by the alphabet. What is missing
// comes last both ways: an empty cell, and among numbers one without a number.
const NUMBER = /^[[<±]?\s*([+-]?[\d,]*\.?\d+(?:e[+-]?\d+)?)/i;

function value(row, column) {
  const text = row.cells[column].textContent.trim().replace("−", "-");
  const found = NUMBER.exec(text);
  return text === "" || text === "–" ? null : found ? Number(found[1].replaceAll(",", "")) : text;
}

function compare(a, b) {
  return typeof a === "number" ? a - b : a.localeCompare(b, "en", { numeric: true });
}

function sort(heading) {
  const table = heading.closest("table"), column = heading.cellIndex;
  const sign = heading.getAttribute("aria-sort") === "ascending" ? -1 : 1;
  for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
  heading.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
  const rows = [...table.tBodies[0].rows].map((row) => [value(row, column), row]);
  const numbers = rows.some(([key]) => typeof key === "number");
  const isThere = ([key]) => key !== null && (!numbers || typeof key === "number");
  const [there, missing] = [rows.filter(isThere), rows.filter((row) => !isThere(row))];
  there.sort(([a], [b]) => sign * compare(a, b));
  table.tBodies[0].append(...[...there, ...missing].map(([, row]) => row));
}

for (const heading of document.querySelectorAll("thead th")) {
  const button = document.createElement("button");
  button.append(...heading.childNodes);
  button.addEventListener("click", () => sort(heading));
  heading.append(button);
}

// Charts: expressions are interpreted and not compiled, so that the page runs no code but its own.
const theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
const options = { renderer: "svg", actions: false, ast: true, tooltip: { theme }, loader: { target: "_self" } };
const drawn = [...document.querySelectorAll("[data-chart]")].map((place) =>
  vegaEmbed(place, JSON.parse(document.getElementById(place.dataset.chart).textContent), options)
);
Promise.all(drawn).then(() => (document.body.dataset.charts = drawn.length));
