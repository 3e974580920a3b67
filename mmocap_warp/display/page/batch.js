// A click on a column's name sorts the rows by it, a second one the other way round.
const body = document.querySelector("tbody");
document.querySelectorAll("th").forEach((head, column) => head.addEventListener("click", () => {
  const sign = head.dataset.sign === "1" ? -1 : 1;
  head.dataset.sign = String(sign);
  const value = (row) => row.cells[column]?.textContent ?? "";
  const number = (row) => (value(row) ? Number.parseFloat(value(row)) : Infinity);
  const order = column ? (a, b) => number(a) - number(b) : (a, b) => value(a).localeCompare(value(b));
  body.append(...[...body.rows].sort((a, b) => sign * order(a, b)));
}));
