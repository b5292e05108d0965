import { recallJson, remember } from "../../logic/storage";

export interface PlotChoice {
  readonly key: number;
  readonly signals: readonly string[];
}

export const MOST_PLOTS = 8;
export const MOST_SIGNALS = 8;

const FIRST: readonly (readonly string[])[] = [
  ["lanes/ins_ekf:roll", "lanes/ins_ekf:pitch"],
  ["lanes/ins_ekf:alt_m", "lanes/onboard:alt_m", "lanes/reference:alt_m"],
  ["lanes/ins_ekf:vel_n_m_s", "lanes/ins_ekf:vel_e_m_s", "lanes/ins_ekf:vel_d_m_s"],
];

function isChoice(value: unknown): value is string[][] {
  return (
    Array.isArray(value) &&
    value.every((plot) => Array.isArray(plot) && plot.every((signal) => typeof signal === "string"))
  );
}

/** Which signals are on which plot; kept on this browser. */
class PlotLayout {
  plots = $state.raw<readonly PlotChoice[]>([]);
  selected = $state(0);
  private lastKey = 0;

  constructor() {
    this.plots = recallJson(
      "plots",
      FIRST.map((each) => [...each]),
      isChoice,
    ).map((signals) => this.made(signals));
    this.selected = this.plots[0]?.key ?? 0;
  }

  private made(signals: readonly string[]): PlotChoice {
    return { key: ++this.lastKey, signals };
  }

  private keep(plots: readonly PlotChoice[]): void {
    this.plots = plots;
    remember("plots", JSON.stringify(plots.map((each) => each.signals)));
  }

  addPlot(): void {
    if (this.plots.length >= MOST_PLOTS) return;
    const plot = this.made([]);
    this.keep([...this.plots, plot]);
    this.selected = plot.key;
  }

  removePlot(key: number): void {
    this.keep(this.plots.filter((each) => each.key !== key));
    if (this.selected === key) this.selected = this.plots.at(-1)?.key ?? 0;
  }

  /** Put a signal on a plot (once), on the selected one by default, on a new one when there is none. */
  add(signal: string, key = this.selected): void {
    if (!this.plots.some((each) => each.key === key)) {
      this.addPlot();
      key = this.selected;
    }
    this.change(key, (signals) =>
      [...signals.filter((each) => each !== signal), signal].slice(-MOST_SIGNALS),
    );
    this.selected = key;
  }

  remove(signal: string, key: number): void {
    this.change(key, (signals) => signals.filter((each) => each !== signal));
  }

  private change(key: number, edit: (signals: readonly string[]) => readonly string[]): void {
    this.keep(this.plots.map((each) => (each.key === key ? { ...each, signals: edit(each.signals) } : each)));
  }
}

export const layout = new PlotLayout();
