"use strict";
// Values under the pointer, or under a cursor that the arrow keys move. They are read
// from the figure's own table: data-across says which value of its first column lies
// where, data-levels how high each row lies.
(() => {
  const tip = document.getElementById("tip");
  let shown = null;
  const hide = () => {
    tip.hidden = true;
    shown?.cursor.remove();
    shown = null;
  };
  const rowsOf = chart => [...(chart.closest("figure").querySelector("details tbody")?.rows ?? [])];
  const placesOf = (chart, rows) => {
    if (chart.dataset.levels) return chart.dataset.levels.split(" ").map(Number);
    const [kind, low, high, start, end] = chart.dataset.across.split(" ");
    const scaled = value => kind === "log" ? Math.log(Number(value)) : Number(value);
    return rows.map(row => Number(start) + (end - start)
      * (scaled(row.cells[0].textContent) - scaled(low)) / (scaled(high) - scaled(low)));
  };
  const show = (chart, place, event) => {
    const rows = rowsOf(chart);
    if (!rows.length) return;
    hide();
    const k = Math.min(Math.max(place, 0), rows.length - 1);
    const at = placesOf(chart, rows)[k];
    const heads = [...rows[k].closest("table").tHead.rows[0].cells].map(cell => cell.textContent);
    tip.textContent = [...rows[k].cells].map((cell, column) => [heads[column], cell.textContent])
      .filter(([, text]) => text !== "").map(pair => pair.join(": ")).join("\n");
    const cursor = document.createElementNS("http://www.w3.org/2000/svg", "path");
    const box = chart.viewBox.baseVal;
    cursor.setAttribute("class", "cursor");
    const [top, bottom] = (chart.dataset.across ?? "").split(" ").slice(-2);
    cursor.setAttribute("d", chart.dataset.levels ? `M0 ${at + 13}H${box.width}` : `M${at} ${top}V${bottom}`);
    chart.append(cursor);
    shown = { chart, place: k, cursor };
    tip.hidden = false;
    const around = chart.getBoundingClientRect();
    const x = event?.clientX ?? around.left + (chart.dataset.levels ? 40 : at * around.width / box.width);
    const y = event?.clientY ?? around.top + around.height / 3;
    tip.style.left = `${Math.max(4, x + 16 + tip.offsetWidth > innerWidth ? x - 16 - tip.offsetWidth : x + 16)}px`;
    tip.style.top = `${Math.max(4, Math.min(y + 12, innerHeight - tip.offsetHeight - 4))}px`;
  };
  for (const chart of document.querySelectorAll("svg[data-across], svg[data-levels]")) {
    for (const title of chart.querySelectorAll("title")) title.remove(); // Not two tips at once.
    const near = event => {
      const matrix = chart.getScreenCTM();
      if (!matrix) return 0;
      const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(matrix.inverse());
      const wanted = chart.dataset.levels ? point.y : point.x;
      const far = placesOf(chart, rowsOf(chart)).map(place => Math.abs(place - wanted));
      return far.indexOf(Math.min(...far));
    };
    chart.addEventListener("pointermove", event => show(chart, near(event), event));
    chart.addEventListener("pointerleave", hide);
    chart.addEventListener("blur", hide);
    chart.addEventListener("keydown", event => {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (event.key === "Escape") hide();
      if (!step) return;
      event.preventDefault();
      show(chart, shown?.chart === chart ? shown.place + step : step > 0 ? 0 : Infinity);
    });
  }
})();
