"use strict";
// Saving a picture or a table from the page itself; opening what is folded before it is printed.
function hand(name, type, content) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([content], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
function csv(table) {
  const cell = (one) => {
    const text = one.textContent.trim().replace(/\u2212/g, "-");
    return /[",\n]/.test(text) ? '"' + text.replace(/"/g, '""') + '"' : text;
  };
  return [...table.rows].map((row) => [...row.cells].map(cell).join(",")).join("\n") + "\n";
}
document.addEventListener("click", (event) => {
  const button = event.target.closest("button.save");
  if (!button) return;
  const figure = button.closest("figure");
  const table = figure.querySelector("table");
  if (table) hand(table.dataset.name + ".csv", "text/csv", csv(table));
  else {
    const svg = figure.querySelector("svg");
    hand(button.dataset.save + ".svg", "image/svg+xml", new XMLSerializer().serializeToString(svg));
  }
});
addEventListener("beforeprint", () => {
  for (const one of document.querySelectorAll("details")) one.open = true;
});
