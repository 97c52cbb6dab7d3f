/** Labels of table cells for phones, on which app.css shows each row as a card. */

/** Media query of a phone, as in the style sheets. */
const PHONE = "(max-width: 40rem)";

/** Number of characters above which a cell needs the width of the card. */
const LONG_TEXT = 26;

/** Writes the header of each column into its cells, and the roles that a browser drops when a table is shown as blocks. */
export function labelCells(table: HTMLTableElement) {
  const heads = [...(table.tHead?.rows[0]?.cells ?? [])].map(headText);
  table.setAttribute("role", "table");
  for (const body of table.tBodies) {
    body.setAttribute("role", "rowgroup");
    for (const row of body.rows) {
      row.setAttribute("role", "row");
      let column = 0;
      for (const cell of row.cells) {
        cell.setAttribute("role", "cell");
        // A cell over several columns is a note about the row and needs no label.
        const label = cell.colSpan > 1 ? "" : (heads[column] ?? "");
        if (cell.dataset["label"] !== label) cell.dataset["label"] = label;
        const size = sizeOf(cell, column);
        if (cell.dataset["size"] !== size) cell.dataset["size"] = size;
        column += cell.colSpan;
      }
    }
  }
}

/** Place of a cell in a card: the title, a title that is a number and needs its label, the whole width, a column, or none. */
type CellSize = "title" | "number" | "long" | "short" | "none";

/** Returns the place that a cell needs in a card. */
function sizeOf(cell: HTMLTableCellElement, column: number): CellSize {
  const text = cell.textContent.trim();
  if (text === "" && cell.childElementCount === 0) return "none";
  if (column === 0 && cell.colSpan === 1) return /^[\d.,]+$/.test(text) ? "number" : "title";
  return text.length > LONG_TEXT || cell.colSpan > 1 ? "long" : "short";
}

/** Returns the text of a header without the explanations of its terms. */
function headText(cell: HTMLTableCellElement): string {
  const copy = cell.cloneNode(true) as HTMLTableCellElement;
  copy.querySelectorAll("[popover]").forEach((popover) => popover.remove());
  return copy.textContent.trim();
}

/** Labels the cells of all wide tables in an element on phones, also those that appear later. */
export function tableCards(node: HTMLElement) {
  const phone = matchMedia(PHONE);
  let frame = 0;
  const label = () => {
    frame = 0;
    if (phone.matches) node.querySelectorAll<HTMLTableElement>(".wide > table").forEach(labelCells);
  };
  const schedule = () => {
    if (phone.matches && frame === 0) frame = requestAnimationFrame(label);
  };
  const observer = new MutationObserver(schedule);
  observer.observe(node, { childList: true, subtree: true });
  phone.addEventListener("change", schedule);
  label();
  return () => {
    observer.disconnect();
    phone.removeEventListener("change", schedule);
    cancelAnimationFrame(frame);
  };
}
