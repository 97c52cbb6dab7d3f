/** Light, dark, or as the machine has it. */
export type Theme = "auto" | "light" | "dark";

const KEY = "sparring.theme";
const dark = matchMedia("(prefers-color-scheme: dark)");

function known(text: string | null): Theme {
  return text === "light" || text === "dark" ? text : "auto";
}

class Appearance {
  chosen = $state<Theme>(known(localStorage.getItem(KEY)));
  #machine = $state(dark.matches);

  constructor() {
    dark.addEventListener("change", (event) => (this.#machine = event.matches));
  }

  get dark() {
    return this.chosen === "auto" ? this.#machine : this.chosen === "dark";
  }

  turn() {
    this.chosen = this.chosen === "auto" ? "light" : this.chosen === "light" ? "dark" : "auto";
    localStorage.setItem(KEY, this.chosen);
  }
}

export const appearance = new Appearance();
