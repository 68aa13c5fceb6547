"use strict";
// One page at a time, and tables that sort. Without this the report is one long page.
(() => {
  const root = document.documentElement;
  const pages = [...document.querySelectorAll("main > .page")];
  const links = [...document.querySelectorAll(".pages a")];

  function show(moveFocus) {
    const id = decodeURIComponent(location.hash.slice(1));
    const target = document.getElementById(id);
    const page = (target && target.closest(".page")) || pages[0];
    root.classList.toggle("paged", id !== "all");
    for (const other of pages) other.classList.toggle("shown", other === page);
    for (const link of links) {
      const here = link.hash === (id === "all" ? "#all" : "#" + page.id);
      if (here) link.setAttribute("aria-current", "page");
      else link.removeAttribute("aria-current");
    }
    if (!moveFocus) return;
    if (target && target !== page && id !== "all") target.scrollIntoView();
    else window.scrollTo(0, 0);
    const heading = page.querySelector("h2");
    heading.tabIndex = -1;
    heading.focus({ preventScroll: true });
  }

  window.addEventListener("hashchange", () => show(true));
  for (const link of document.querySelectorAll(".pages .scripted")) link.hidden = false;
  show(false);

  const leading = /^[+-]?\d[\d,]*\.?\d*/;

  function key(row, column) {
    const cell = row.cells[column];
    const text = cell ? cell.textContent.trim().replace(/−/g, "-") : "";
    const found = leading.exec(text);
    return found ? Number(found[0].replace(/,/g, "")) : text === "–" ? "" : text;
  }

  function compare(a, b, sign) {
    if (a === "" || b === "") return (a === "") - (b === ""); // what is unknown comes last
    if (typeof a === "number" && typeof b === "number") return sign * (a - b);
    if (typeof a === "number") return -1;
    return typeof b === "number" ? 1 : sign * a.localeCompare(b, "en", { numeric: true });
  }

  function sort(table, header, column) {
    const sign = header.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    for (const other of table.tHead.querySelectorAll("th")) other.removeAttribute("aria-sort");
    header.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
    const body = table.tBodies[0];
    const rows = [...body.rows];
    const free = rows.filter((row) => !row.classList.contains("total"));
    const fixed = rows.filter((row) => row.classList.contains("total"));
    free.sort((a, b) => compare(key(a, column), key(b, column), sign));
    body.append(...free, ...fixed);
  }

  for (const table of document.querySelectorAll("table.sortable")) {
    const headers = [...table.tHead.rows[table.tHead.rows.length - 1].cells];
    headers.forEach((header, column) => {
      if (header.classList.contains("fixed")) return;
      const button = document.createElement("button");
      button.type = "button";
      button.append(...header.childNodes);
      button.addEventListener("click", () => sort(table, header, column));
      header.append(button);
    });
  }
})();
