"use strict";
(() => {
  const root = document.documentElement;
  const made = (name, properties) => Object.assign(document.createElement(name), properties);

  // Light or dark: the system's choice until the reader has chosen.
  const theme = document.getElementById("theme");
  const dark = () => root.dataset.theme
    ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  const named = () => { theme.textContent = dark() ? "Light" : "Dark";
    theme.setAttribute("aria-label", dark() ? "Light colours" : "Dark colours"); };
  theme.addEventListener("click", () => { root.dataset.theme = dark() ? "light" : "dark"; named(); });
  theme.hidden = false;
  named();

  // Tables that sort: numbers as numbers, missing values last either way.
  const value = (row, column) => {
    const cell = row.cells[column];
    if (!cell || cell.classList.contains("missing")) return null;
    const text = cell.dataset.value ?? cell.textContent.trim();
    return text === "" ? null : isNaN(text) ? text : Number(text);
  };
  const compared = (a, b) => typeof a === typeof b && typeof a === "number" ? a - b
    : String(a).localeCompare(String(b), "en", { numeric: true });
  const sort = (table, column, sign) => {
    for (const body of table.tBodies) {
      const rows = [...body.rows].map((row, place) => [value(row, column), place, row]);
      rows.sort(([a, i], [b, j]) => a === null || b === null
        ? (a === null) - (b === null) || i - j : sign * compared(a, b) || i - j);
      body.append(...rows.map(([, , row]) => row));
    }
  };
  for (const table of document.querySelectorAll("table.sortable")) {
    const heads = [...table.tHead.rows].at(-1).cells;
    [...heads].forEach((head, column) => {
      if (head.classList.contains("plain")) return;
      const button = made("button", { type: "button" });
      button.append(...head.childNodes);
      head.append(button);
      button.addEventListener("click", () => {
        const up = head.getAttribute("aria-sort") !== "ascending";
        for (const other of heads) other.removeAttribute("aria-sort");
        head.setAttribute("aria-sort", up ? "ascending" : "descending");
        sort(table, column, up ? 1 : -1);
      });
    });
    if (!table.dataset.filter) continue;
    const input = made("input", { type: "search", autocomplete: "off" });
    const label = made("label", { className: "filter" });
    const count = made("span", { className: "note" });
    count.setAttribute("role", "status");
    input.addEventListener("input", () => {
      const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
      let shown = 0, all = 0;
      for (const body of table.tBodies) for (const row of body.rows) {
        const text = row.textContent.toLowerCase();
        row.hidden = !words.every(word => text.includes(word));
        shown += !row.hidden;
        all += 1;
      }
      count.textContent = words.length ? `${shown} of ${all} rows` : "";
    });
    label.append(table.dataset.filter, input, count);
    (table.closest(".scroll") ?? table).before(label);
  }

  // A box that is narrower than its content says so, as long as something is cut.
  for (const box of document.querySelectorAll(".scroll")) {
    const hint = made("p", { className: "note hint", hidden: true,
      textContent: "There is more to the right: scroll sideways \u2192" });
    box.before(hint);
    const told = () => {
      const cut = box.scrollWidth > box.clientWidth + 1;
      hint.hidden = !cut;
      box.classList.toggle("cut", cut);
    };
    const watch = new ResizeObserver(told);
    watch.observe(box);
    for (const inner of box.children) watch.observe(inner);
    told();
  }

  // Buttons that copy. Without a clipboard (an old browser): select, to copy by hand.
  for (const button of document.querySelectorAll("button[data-copy]")) {
    const source = document.getElementById(button.dataset.copy);
    const words = button.textContent;
    button.hidden = false;
    button.setAttribute("aria-live", "polite");
    button.addEventListener("click", async () => {
      try {
        await navigator.clipboard.writeText(source.textContent);
        button.textContent = "Copied";
      } catch {
        getSelection().selectAllChildren(source);
        button.textContent = "Selected: press Ctrl+C";
      }
      setTimeout(() => { button.textContent = words; }, 2500);
    });
  }

  // What is printed: all that is folded away, but for the figures' tables of values.
  addEventListener("beforeprint", () => {
    for (const folded of document.querySelectorAll("details:not(figure details)")) folded.open = true;
  });
})();
