/* Tables: sorted by their heads, filtered by the scenario that is shown, saved as CSV. */
function save(name, parts, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob(parts, { type }));
  link.download = name;
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

/* Sort a table by a column; rows without a number come last. */
function sort(table, column, turn) {
  const body = table.tBodies[0], rows = [...body.rows];
  const key = (row) => row.cells[column].dataset.key ?? row.cells[column].textContent.trim();
  const numeric = rows.some((row) => row.cells[column].dataset.key !== undefined);
  rows.sort((a, b) => {
    const [one, other] = [key(a), key(b)];
    if (!numeric) return turn * one.localeCompare(other);
    if (one === "" || other === "") return (one === "") - (other === "");
    return turn * (Number(one) - Number(other) || 0);
  });
  body.append(...rows);
  all("th", table).forEach((head, k) => {
    if (k === column) head.setAttribute("aria-sort", turn > 0 ? "ascending" : "descending");
    else head.removeAttribute("aria-sort");
  });
}

function setUpTables() {
  for (const table of all("table.sortable")) {
    all("th", table).forEach((head, column) => head.addEventListener("click", () => {
      if (table.tBodies[0].rows[0].cells.length > 1) sort(table, column, head.getAttribute("aria-sort") === "ascending" ? -1 : 1);
    }));
  }
  for (const button of all("button[data-table]")) {
    const name = button.dataset.table;
    button.addEventListener("click", () => save(`${name}.csv`, [data.tables[name]], "text/csv"));
  }
}

function filterTables(scenario) {
  for (const row of all("table.filtered tbody tr[data-scenario]")) row.hidden = row.dataset.scenario !== scenario;
}
