/* The leaderboard: sorting and filtering. */
let tellBoard, heedBoard; // to and from the page's address

function setUpBoard() {
  const table = byId("board"), body = table.tBodies[0], rows = all("tr", body);
  const heads = all("thead th", table), sorter = byId("board-sort");
  const words = Number(table.dataset.words || 3); // number of columns that are searched
  const given = new Map(rows.map((row, k) => [row, k]));
  const keyOf = (row, column) => {
    const cell = row.cells[column];
    if (cell.dataset.key === undefined) return cell.textContent.trim().toLowerCase();
    return cell.dataset.key === "" ? NaN : Number(cell.dataset.key);
  };
  const compare = (a, b) => {
    if (typeof a === "string") return a.localeCompare(b);
    return a < b ? -1 : a > b ? 1 : 0;
  };
  function sort(column, direction) {
    heads.forEach((head, k) => {
      if (k === column) head.setAttribute("aria-sort", direction > 0 ? "ascending" : "descending");
      else head.removeAttribute("aria-sort");
    });
    const sorted = [...rows].sort((a, b) => {
      const [p, q] = [keyOf(a, column), keyOf(b, column)];
      const missing = Number(Number.isNaN(p)) - Number(Number.isNaN(q));
      return missing || direction * compare(p, q) || given.get(a) - given.get(b);
    });
    body.append(...sorted);
    sorter.value = `${column} ${direction}`;
    rule();
    writeAddress();
  }
  function unsort() {
    heads.forEach((head) => head.removeAttribute("aria-sort"));
    body.append(...rows);
    sorter.value = "";
    rule();
    writeAddress();
  }
  function filter() {
    const wanted = byId("filter").value.toLowerCase().split(/\s+/).filter(Boolean);
    const sensor = byId("board-sensor").value;
    let shown = 0;
    for (const row of rows) {
      const text = [...row.cells].slice(0, words).map((cell) => cell.textContent).join(" ").toLowerCase();
      row.hidden = !(wanted.every((word) => text.includes(word)) && (!sensor || row.dataset.sensor === sensor));
      shown += !row.hidden;
    }
    byId("board-count").textContent = shown === rows.length ? `${shown} rows` : `${shown} of ${rows.length} rows`;
    rule();
    writeAddress();
  }
  /* A line between scenarios and sensors where neighbouring rows belong together. */
  function rule() {
    const sorted = heads.some((head) => head.hasAttribute("aria-sort"));
    const visible = all("tr", body).filter((row) => !row.hidden);
    visible.forEach((row, k) => {
      const group = (r) => `${r.cells[0].textContent}\n${r.cells[1].textContent}`;
      row.classList.toggle("group", !sorted && k > 0 && group(row) !== group(visible[k - 1]));
    });
  }
  sorter.append(new Option("scenario, sensor, rank", ""));
  heads.forEach((head, column) => {
    if ("nosort" in head.dataset) return;
    const button = document.createElement("button"), name = head.textContent.trim();
    button.type = "button";
    button.textContent = name;
    head.dataset.name = name;
    head.replaceChildren(button);
    button.addEventListener("click", () => sort(column, head.getAttribute("aria-sort") === "ascending" ? -1 : 1));
    sorter.append(new Option(`${name} ↑`, `${column} 1`), new Option(`${name} ↓`, `${column} -1`));
  });
  sorter.addEventListener("change", () => {
    if (sorter.value) sort(...sorter.value.split(" ").map(Number)); else unsort();
  });
  byId("board-all").addEventListener("click", (event) => {
    event.target.setAttribute("aria-pressed", String(table.classList.toggle("all")));
  });
  byId("filter").addEventListener("input", filter);
  byId("board-sensor").addEventListener("change", filter);
  tellBoard = (say) => {
    const by = heads.find((head) => head.hasAttribute("aria-sort"));
    if (by) say("sort", `${by.getAttribute("aria-sort") === "descending" ? "-" : ""}${by.dataset.name}`);
    say("filter", byId("filter").value);
    say("sensor", byId("board-sensor").value);
  };
  heedBoard = (said) => {
    const wanted = said.get("sort") || "", down = wanted.startsWith("-");
    const column = heads.findIndex((head) => head.dataset.name === (down ? wanted.slice(1) : wanted));
    if (column >= 0) sort(column, down ? -1 : 1); else unsort();
    byId("filter").value = said.get("filter") || "";
    byId("board-sensor").value = said.get("sensor") || "";
    if (byId("board-sensor").selectedIndex < 0) byId("board-sensor").value = "";
    filter();
  };
}
