"use strict";
// Rows stand in the page as data, and become a table piece by piece: ten thousand at once would keep a reader waiting.
const source = document.getElementById("rows"), body = document.querySelector("tbody"), more = document.getElementById("more");
const rows = JSON.parse(source.textContent), piece = Number(source.dataset.piece);
const search = document.querySelector("#filter input"), shown = document.getElementById("shown");
let wanted = rows, count = Math.min(piece, rows.length);

function line([page, ...cells]) {
  const row = document.createElement("tr");
  cells.forEach((text, place) => {
    const cell = row.insertCell();
    cell.className = place === 2 ? "words" : "name";
    const holder = place === 0 && page ? cell.appendChild(document.createElement("a")) : cell;
    if (holder !== cell) holder.href = page;
    holder.textContent = text;
  });
  return row;
}

function tell() {
  shown.textContent = `${wanted.length} of ${rows.length} logs`;
  more.hidden = count >= wanted.length;
}

function add() {
  body.append(...wanted.slice(count, count + piece).map(line));
  count = Math.min(count + piece, wanted.length);
  tell();
}

search.addEventListener("input", () => {
  const words = search.value.toLowerCase().split(/\s+/).filter(Boolean);
  wanted = rows.filter((row) => words.every((word) => row.join("\n").toLowerCase().includes(word)));
  body.replaceChildren();
  count = 0;
  add();
});
more.firstElementChild.addEventListener("click", add);
new IntersectionObserver((seen) => { if (seen[0].isIntersecting && !more.hidden) add(); }, { rootMargin: "600px" }).observe(more);
document.getElementById("filter").hidden = false;
tell();
