/** Colour scheme: light, dark, or that of the operating system. */
export type Theme = "auto" | "light" | "dark";

const STORAGE_KEY = "sparring.theme";
const systemDark = matchMedia("(prefers-color-scheme: dark)");

function parseTheme(text: string | null): Theme {
  return text === "light" || text === "dark" ? text : "auto";
}

class Appearance {
  theme = $state<Theme>(parseTheme(localStorage.getItem(STORAGE_KEY)));
  #systemDark = $state(systemDark.matches);

  constructor() {
    systemDark.addEventListener("change", (event) => (this.#systemDark = event.matches));
  }

  get dark() {
    return this.theme === "auto" ? this.#systemDark : this.theme === "dark";
  }

  /** Switches to the next theme: auto, light, dark. */
  cycle() {
    this.theme = this.theme === "auto" ? "light" : this.theme === "light" ? "dark" : "auto";
    localStorage.setItem(STORAGE_KEY, this.theme);
  }
}

export const appearance = new Appearance();
