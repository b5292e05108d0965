import type { Ring } from "../live/ring";
import { angleBetween, differenceOf, newestKnown, type Quantity } from "./difference";
import type { Quat } from "./angles";
import { LANE_QUANTITIES, type LaneQuantity } from "./lanes";
import { laneSignal } from "./signals";

/** One number of a lane and how much more it is than the yardstick's; NaN = not known. */
export interface Cell {
  readonly value: number;
  readonly difference: number;
}

export interface LaneRow {
  readonly cells: Readonly<Record<LaneQuantity, Cell>>;
  /** Total angle to the yardstick's attitude. */
  readonly apartDeg: number;
  /** Horizontal distance to the yardstick's position. */
  readonly apartM: number;
}

const QUANTITIES = Object.fromEntries(
  LANE_QUANTITIES.map((each) => [each, laneSignal("ins_ekf", each)]),
) as unknown as Readonly<Record<LaneQuantity, Quantity>>;

const RAD = Math.PI / 180;

/** The orientation of roll, pitch and heading in degrees. */
export function quatOf(rollDeg: number, pitchDeg: number, headingDeg: number): Quat {
  const [cr, sr] = [Math.cos((rollDeg * RAD) / 2), Math.sin((rollDeg * RAD) / 2)];
  const [cp, sp] = [Math.cos((pitchDeg * RAD) / 2), Math.sin((pitchDeg * RAD) / 2)];
  const [cy, sy] = [Math.cos((headingDeg * RAD) / 2), Math.sin((headingDeg * RAD) / 2)];
  return [
    cr * cp * cy + sr * sp * sy,
    sr * cp * cy - cr * sp * sy,
    cr * sp * cy + sr * cp * sy,
    cr * cp * sy - sr * sp * cy,
  ];
}

/** What a lane says now, beside a yardstick; without one only its own values. */
export function laneRow(ring: Ring, other: Ring | null): LaneRow {
  const cells = Object.fromEntries(
    LANE_QUANTITIES.map((each) => {
      const quantity = QUANTITIES[each];
      const difference = other ? differenceOf(ring, other, quantity) : NaN;
      return [each, { value: newestKnown(ring, quantity).value, difference }];
    }),
  ) as unknown as LaneRow["cells"];
  return { cells, apartDeg: apartDeg(cells), apartM: apartM(cells) };
}

function apartDeg({ roll, pitch, heading }: LaneRow["cells"]): number {
  const mine = quatOf(roll.value, pitch.value, heading.value);
  const theirs = quatOf(
    roll.value - roll.difference,
    pitch.value - pitch.difference,
    heading.value - heading.difference,
  );
  return angleBetween(mine, theirs) / RAD;
}

function apartM({ pos_n_m: north, pos_e_m: east }: LaneRow["cells"]): number {
  return Math.hypot(north.difference, east.difference);
}
