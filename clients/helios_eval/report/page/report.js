// Sorting and filtering of the table of all episodes. Without scripts the table is whole and in order.
for (const box of document.querySelectorAll(".episodes")) {
  const table = box.querySelector("table"), body = table.tBodies[0], rows = [...body.rows];
  const selects = [...box.querySelectorAll("select")], words = box.querySelector("input");
  const count = box.querySelector("output");
  const text = (row, i) => row.cells[i].textContent;
  for (const select of selects) {
    const i = +select.dataset.column;
    for (const value of new Set(rows.map(row => text(row, i)))) select.add(new Option(value, value));
  }
  const filter = () => {
    const wanted = words.value.trim().toLowerCase();
    let shown = 0;
    for (const row of rows) {
      const fits = selects.every(s => !s.value || text(row, +s.dataset.column) === s.value)
        && row.textContent.toLowerCase().includes(wanted);
      row.hidden = !fits;
      shown += fits;
    }
    count.textContent = `${shown} of ${rows.length} episodes`;
  };
  for (const control of [...selects, words]) control.addEventListener("input", filter);
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, i) => head.addEventListener("click", () => {
    const up = head.getAttribute("aria-sort") !== "ascending";
    for (const other of heads) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    const order = new Intl.Collator("en", { numeric: true }).compare;
    rows.sort((a, b) => (up ? 1 : -1) * order(text(a, i), text(b, i)));
    body.append(...rows);
  }));
}
