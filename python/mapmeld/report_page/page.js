"use strict";
for (const viewer of document.querySelectorAll(".viewer")) {
  const svg = viewer.querySelector("svg"), sheet = viewer.querySelector(".sheet");
  const layer = name => svg.querySelector(`[data-layer="${name}"]`);
  const show = (name, on) => layer(name).classList.toggle("off", !on);
  const whole = svg.getAttribute("viewBox").split(" ").map(Number);
  let box = [...whole];

  const draw = () => {
    svg.setAttribute("viewBox", box.join(" "));
    const pixels = Math.min(svg.clientWidth / box[2], svg.clientHeight / box[3]) * Number(svg.dataset.cell);
    svg.style.imageRendering = pixels > 1.5 ? "pixelated" : "auto";
    sheet.classList.toggle("moved", box[2] < whole[2]);
    for (const n of svg.querySelectorAll(".number > :not(title)"))
      n.setAttribute("transform", `scale(${Math.max(box[2] / whole[2], 0.02)})`);
  };
  const zoom = (factor, x, y) => {
    if (!factor) { box = [...whole]; return draw(); }
    const width = Math.min(Math.max(box[2] * factor, whole[2] / 200), whole[2] * 2), f = width / box[2];
    box = [x - (x - box[0]) * f, y - (y - box[1]) * f, width, box[3] * f];
    draw();
  };
  const move = (dx, dy) => { box[0] += dx; box[1] += dy; draw(); };
  const point = e => new DOMPoint(e.clientX, e.clientY).matrixTransform(svg.getScreenCTM().inverse());
  const middle = () => [box[0] + box[2] / 2, box[1] + box[3] / 2];

  for (const b of viewer.querySelectorAll("[data-zoom]"))
    b.addEventListener("click", () => zoom(Number(b.dataset.zoom), ...middle()));
  svg.addEventListener("wheel", e => {
    // The page scrolls on until somebody has clicked the picture.
    if (!e.ctrlKey && document.activeElement !== svg) return;
    if (!sheet.classList.contains("moved") && e.deltaY > 0) return;
    e.preventDefault();
    const p = point(e);
    zoom(e.deltaY < 0 ? 0.85 : 1 / 0.85, p.x, p.y);
    if (box[2] >= whole[2]) zoom(0);
  }, { passive: false });
  let held = null;
  svg.addEventListener("pointerdown", e => { held = point(e); svg.setPointerCapture(e.pointerId); });
  svg.addEventListener("pointermove", e => {
    if (held) { const p = point(e); move(held.x - p.x, held.y - p.y); }
  });
  for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => { held = null; });
  svg.addEventListener("keydown", e => {
    const step = box[2] / 10;
    const keys = { "+": () => zoom(0.8, ...middle()), "=": () => zoom(0.8, ...middle()),
      "-": () => zoom(1.25, ...middle()), "0": () => zoom(0), ArrowLeft: () => move(-step, 0),
      ArrowRight: () => move(step, 0), ArrowUp: () => move(0, -step), ArrowDown: () => move(0, step) };
    if (keys[e.key] && !e.ctrlKey && !e.metaKey) { keys[e.key](); e.preventDefault(); }
  });

  for (const input of viewer.querySelectorAll("input[type=radio]"))
    input.addEventListener("change", () => {
      for (const name of ["robots", "merged", "provenance"]) show(name, name === input.value);
    });
  for (const input of viewer.querySelectorAll(".choice input[type=checkbox]"))
    input.addEventListener("change", () => show(input.value, input.checked));
  for (const input of viewer.querySelectorAll("[data-show]"))
    input.addEventListener("change", () =>
      svg.querySelector(`[data-map="${input.dataset.show}"]`).classList.toggle("off", !input.checked));
  draw();
  addEventListener("resize", draw);
  viewer.querySelector("select").addEventListener("change", e => {
    for (const one of svg.querySelectorAll(".ellipse")) {
      one.setAttribute("rx", one.dataset.rx * e.target.value);
      one.setAttribute("ry", one.dataset.ry * e.target.value);
    }
  });
}

const table = document.getElementById("pair-table");
if (table) {
  const body = table.tBodies[0], count = document.getElementById("pair-count");
  const filter = document.getElementById("pair-filter"), all = document.getElementById("all-pairs");
  const shown = [...body.rows].map(r => [...r.cells].map(c => c.textContent));
  const part = v => v === null ? "" : `${(100 * v).toFixed(0)} %`, fixed = d => v => v === null ? "" : v.toFixed(d);
  const text = [String, String, String, fixed(3), String, String, String, fixed(1), part, part, fixed(1), fixed(1)];
  const numeric = [3, 5, 6, 7, 8, 9, 10, 11];
  let rows = shown, complete = all.hidden;
  const complete_rows = () => {
    if (complete) return;
    const more = JSON.parse(document.getElementById("more-pairs").textContent);
    rows = rows.concat(more.map(r => r.map((v, i) => text[i](v))));
    complete = true; all.hidden = true;
  };
  const draw = () => {
    const wanted = filter.value.trim().toLowerCase();
    const some = wanted ? rows.filter(r => r[0].toLowerCase().includes(wanted) || r[1].toLowerCase().includes(wanted)) : rows;
    const fresh = document.createDocumentFragment();
    for (const r of some) {
      const tr = fresh.appendChild(document.createElement("tr"));
      r.forEach((t, i) => {
        const td = tr.appendChild(document.createElement("td"));
        td.textContent = t;
        td.className = numeric.includes(i) ? "n" : i < 2 ? (t.length > 28 ? "name long" : "name") : i === 2 ? t.replace(" ", "-") : "why";
      });
    }
    body.replaceChildren(fresh);
    count.textContent = some.length < rows.length ? `${some.length} of ${rows.length} pairs are listed.` : `All ${rows.length} pairs are listed.`;
  };
  let wait = 0;
  filter.addEventListener("input", () => {
    clearTimeout(wait);
    wait = setTimeout(() => { complete_rows(); draw(); }, 150);
  });
  all.addEventListener("click", () => { complete_rows(); draw(); });
  // Few pairs are all printed; of many, those that are shown.
  const total = JSON.parse(document.getElementById("more-pairs").textContent).length + shown.length;
  addEventListener("beforeprint", () => {
    if (!complete && total <= 300) { complete_rows(); draw(); }
  });
  table.tHead.querySelectorAll("button").forEach((b, i) => {
    let up = false;
    b.addEventListener("click", () => {
      complete_rows();
      up = numeric.includes(i) ? b.dataset.down === "1" : b.dataset.down !== "0";
      b.dataset.down = up ? "0" : "1";
      const value = r => numeric.includes(i) ? (r[i] === "" ? -Infinity : parseFloat(r[i])) : r[i];
      rows = [...rows].sort((a, c) => (value(a) < value(c) ? -1 : value(a) > value(c) ? 1 : 0) * (up ? 1 : -1));
      draw();
    });
  });
}
let closed = [];
addEventListener("beforeprint", () => {
  closed = [...document.querySelectorAll("details:not([open])")];
  closed.forEach(d => { d.open = true; });
});
addEventListener("afterprint", () => closed.forEach(d => { d.open = false; }));
