"use strict";
// Sort a table by a column; numbers by value, words by alphabet, empty cells last.
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const up = head.getAttribute("aria-sort") !== "ascending";
      heads.forEach((h) => h.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", up ? "ascending" : "descending");
      const key = (row) => row.cells[column].dataset.v ?? row.cells[column].textContent.trim();
      const rows = [...table.tBodies[0].rows].map((row, i) => [key(row), i, row]);
      rows.sort((a, b) => {
        if ((a[0] === "") !== (b[0] === "")) return a[0] === "" ? 1 : -1;
        const [p, q] = [Number(a[0]), Number(b[0])];
        const order = Number.isNaN(p) || Number.isNaN(q) ? a[0].localeCompare(b[0]) : p - q;
        return (up ? order : -order) || a[1] - b[1];
      });
      table.tBodies[0].append(...rows.map((r) => r[2]));
    });
  });
}
// Filter the table of results by the words typed.
for (const input of document.querySelectorAll("input[data-filter]")) {
  const rows = [...document.getElementById(input.dataset.filter).tBodies[0].rows];
  input.addEventListener("input", () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    for (const row of rows) row.hidden = !words.every((w) => row.textContent.toLowerCase().includes(w));
  });
}
// A picture opens at full size; Escape or a click closes it.
const dialog = document.getElementById("zoom");
for (const image of document.querySelectorAll("figure img")) {
  const open = () => {
    dialog.querySelector("img").src = image.src;
    dialog.querySelector("img").alt = image.alt;
    dialog.showModal();
  };
  image.addEventListener("click", open);
  image.addEventListener("keydown", (event) => { if (event.key === "Enter") open(); });
}
dialog.addEventListener("click", () => dialog.close());
// The value of a point, beside it.
const tip = document.getElementById("tip");
for (const dot of document.querySelectorAll("[data-tip]")) {
  const show = () => {
    const box = dot.getBoundingClientRect();
    tip.textContent = dot.dataset.tip;
    tip.hidden = false;
    const left = Math.min(box.left + 12, window.innerWidth - tip.offsetWidth - 8);
    tip.style.left = `${Math.max(8, left) + window.scrollX}px`;
    tip.style.top = `${box.top + window.scrollY - tip.offsetHeight - 8}px`;
  };
  dot.querySelector("title")?.remove();
  dot.setAttribute("aria-label", dot.dataset.tip);
  dot.addEventListener("pointerenter", show);
  dot.addEventListener("focus", show);
  dot.addEventListener("pointerleave", () => { tip.hidden = true; });
  dot.addEventListener("blur", () => { tip.hidden = true; });
}
