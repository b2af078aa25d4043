/* What can be saved: tables as CSV, figures as SVG and PNG. */
function save(name, parts, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob(parts, { type }));
  link.download = name;
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

const fileName = (...words) => words.join("-").replace(/[^\w.=-]+/g, "_");

function setUpTables() {
  for (const button of all("button[data-table]")) {
    const name = button.dataset.table;
    button.addEventListener("click", () => save(`${name}.csv`, [data.tables[name]], "text/csv"));
  }
}

/* A figure as SVG: what `draw` draws on a canvas, under a title and over a legend.

   entries: [colour, text] of the legend. */
function vectorFigure(canvas, draw, title, entries) {
  const pad = 10, head = 30, row = 18, width = Math.max(320, canvas.clientWidth);
  const context = instead(() => new VectorContext(canvas.clientWidth, canvas.clientHeight), draw);
  const text = new VectorContext(width, 0), ink = css("--ink");
  let x = 0, y = 0;
  Object.assign(text, { textBaseline: "middle" });
  for (const [colour, label] of entries) {
    const length = 22 + 6.6 * label.length;
    if (x && x + length > width) { x = 0; y += row; }
    text.beginPath(); text.rect(x, y + 4, 10, 10); text.fillStyle = colour; text.fill();
    text.fillStyle = ink; text.fillText(label, x + 15, y + 9);
    x += length;
  }
  const foot = entries.length ? y + row + 6 : 0, height = head + canvas.clientHeight + foot + pad;
  const heading = new VectorContext(width, head);
  Object.assign(heading, { font: "600 14px sans-serif", fillStyle: ink, textBaseline: "middle" });
  heading.fillText(title, 0, head / 2);
  const size = [width + 2 * pad, height + pad];
  return { width: size[0], height: size[1], text: `<svg xmlns="http://www.w3.org/2000/svg" width="${size[0]}" height="${size[1]}" viewBox="0 0 ${size[0]} ${size[1]}" font-family="system-ui, sans-serif"><rect width="100%" height="100%" fill="${css("--card")}"/><g transform="translate(${pad} ${pad})">${heading.elements()}<g transform="translate(0 ${head})">${context.elements()}</g><g transform="translate(0 ${head + canvas.clientHeight + 6})">${text.elements()}</g></g></svg>` };
}

/* Buttons that save a figure; `figure` makes one of `vectorFigure`, `name` its file's name. */
function saveButtons(figure, name) {
  const svg = button("SVG", "Save this figure as SVG"), png = button("PNG", "Save this figure as PNG");
  svg.addEventListener("click", () => save(`${name()}.svg`, [figure().text], "image/svg+xml"));
  png.addEventListener("click", () => {
    const made = figure(), image = new Image(), scale = 2;
    image.addEventListener("load", () => {
      const canvas = document.createElement("canvas");
      canvas.width = made.width * scale;
      canvas.height = made.height * scale;
      canvas.getContext("2d").drawImage(image, 0, 0, canvas.width, canvas.height);
      canvas.toBlob((blob) => save(`${name()}.png`, [blob], "image/png"), "image/png");
    });
    image.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(made.text)}`;
  });
  const holder = document.createElement("span");
  holder.className = "saves";
  holder.append(svg, png);
  return holder;
}

function button(text, title) {
  const made = document.createElement("button");
  made.type = "button";
  made.textContent = text;
  made.title = title;
  made.setAttribute("aria-label", title);
  return made;
}
