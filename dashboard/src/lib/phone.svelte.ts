/** What pages leave out on a phone until the user asks for it. */
import { MediaQuery } from "svelte/reactivity";

/** True on a phone, as in the style sheets. */
const phone = new MediaQuery("(max-width: 40rem)");

/** Number of cards of a list that a phone shows first. */
const FIRST_CARDS = 20;

export function isPhone(): boolean {
  return phone.current;
}

/** Rows of a table, which are cards on a phone: it shows the first ones until the user asks for all. */
export class PhoneRows {
  #showsAll = $state(false);

  /** Returns the rows to show. */
  of<T>(rows: readonly T[]): readonly T[] {
    return isPhone() && !this.#showsAll ? rows.slice(0, FIRST_CARDS) : rows;
  }

  /** Returns the number of rows that are left out. */
  hidden(rows: readonly unknown[]): number {
    return rows.length - this.of(rows).length;
  }

  showAll() {
    this.#showsAll = true;
  }
}
