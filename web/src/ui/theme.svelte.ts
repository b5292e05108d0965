import { recall, remember } from "../logic/storage";

export type ThemeChoice = "auto" | "dark" | "light";
const CHOICES: readonly ThemeChoice[] = ["auto", "dark", "light"];

class Theme {
  choice = $state<ThemeChoice>("auto");
  private systemLight = $state(false);
  readonly applied = $derived<"dark" | "light">(
    this.choice === "auto" ? (this.systemLight ? "light" : "dark") : this.choice,
  );

  constructor() {
    const stored = recall("theme", "auto");
    this.choice = CHOICES.find((each) => each === stored) ?? "auto";
    if (typeof matchMedia !== "function") return; // tests run without a browser
    const query = matchMedia("(prefers-color-scheme: light)");
    this.systemLight = query.matches;
    query.addEventListener("change", (event) => (this.systemLight = event.matches));
  }

  next(): void {
    this.choice = CHOICES[(CHOICES.indexOf(this.choice) + 1) % CHOICES.length] ?? "auto";
    remember("theme", this.choice);
  }
}

export const theme = new Theme();

/** Value of a colour token now, for what is drawn on a canvas. */
export function token(name: string): string {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}
