import { recallJson, remember } from "../../logic/storage";
import { LANE_QUANTITIES, type LaneQuantity } from "../../logic/lanes";

export const SECTIONS = ["lanes", "compare", "plots", "aids"] as const;
export type Section = (typeof SECTIONS)[number];

interface Kept {
  readonly yardstick: string;
  readonly open: string;
  readonly section: Section;
  readonly quantities: readonly LaneQuantity[];
  readonly hidden: readonly string[];
  readonly values: boolean;
  readonly differences: boolean;
}

const FIRST: Kept = {
  yardstick: "",
  open: "",
  section: "lanes",
  quantities: ["roll", "heading", "height"],
  hidden: [],
  values: true,
  differences: true,
};

function isKept(value: unknown): value is Kept {
  const kept = value as Partial<Kept> | null;
  return (
    typeof kept?.yardstick === "string" &&
    typeof kept.open === "string" &&
    SECTIONS.some((each) => each === kept.section) &&
    Array.isArray(kept.quantities) &&
    kept.quantities.every((each) => LANE_QUANTITIES.includes(each)) &&
    Array.isArray(kept.hidden) &&
    typeof kept.values === "boolean" &&
    typeof kept.differences === "boolean"
  );
}

/** What a person picked on the Estimators place; kept on this browser, so that a reload shows the same. */
class Picks {
  private kept = $state.raw<Kept>(recallJson("estimators", FIRST, isKept));

  get now(): Kept {
    return this.kept;
  }

  change(part: Partial<Kept>): void {
    this.kept = { ...this.kept, ...part };
    remember("estimators", JSON.stringify(this.kept));
  }

  toggleQuantity(quantity: LaneQuantity): void {
    const { quantities } = this.kept;
    const without = quantities.filter((each) => each !== quantity);
    const next = without.length < quantities.length ? without : [...quantities, quantity];
    this.change({ quantities: LANE_QUANTITIES.filter((each) => next.includes(each)) });
  }

  toggleLane(lane: string): void {
    const without = this.kept.hidden.filter((each) => each !== lane);
    this.change({ hidden: without.length < this.kept.hidden.length ? without : [...without, lane] });
  }
}

export const picks = new Picks();
