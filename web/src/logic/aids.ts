import type { AidOut } from "../api/wire";
import { AID_COLUMNS, AIDS } from "../live/columns";
import type { Ring } from "../live/ring";
import type { Signal } from "./signals";

const RAD_TO_DEG = 180 / Math.PI;

interface AidLook {
  /** Keys of the catalogue (`axis.…`) for its components; null = this one is never used. */
  readonly axes: readonly (string | null)[];
  readonly unit: string;
  readonly factor: number;
}

const NED = ["north", "east", "down"];
const BODY = ["x", "y", "z"];

/** What the components of an aid's innovation are and how they are shown. */
export const AID_LOOK: Readonly<Record<string, AidLook>> = {
  gnss_position: { axes: NED, unit: "m", factor: 1 },
  gnss_velocity: { axes: NED, unit: "m/s", factor: 1 },
  baro_height: { axes: ["height"], unit: "m", factor: 1 },
  mag_field: { axes: NED, unit: "µT", factor: 100 },
  zero_velocity: { axes: NED, unit: "m/s", factor: 1 },
  zero_rate: { axes: BODY, unit: "°/s", factor: RAD_TO_DEG },
  airspeed: { axes: ["along"], unit: "m/s", factor: 1 },
  sideslip: { axes: ["y", "z"], unit: "m/s", factor: 1 },
  gravity: { axes: NED, unit: "m/s²", factor: 1 },
  wheels: { axes: [null, "y", "z"], unit: "m/s", factor: 1 },
  drag: { axes: ["x", "y"], unit: "m/s²", factor: 1 },
  yaw: { axes: ["heading"], unit: "°", factor: RAD_TO_DEG },
  gnss_course: { axes: ["heading"], unit: "°", factor: RAD_TO_DEG },
};
const PLAIN: AidLook = { axes: BODY, unit: "", factor: 1 };

export function aidLook(aid: string): AidLook {
  return AID_LOOK[aid] ?? PLAIN;
}

/** How many σ off a measurement of this aid is refused, read back from its last record; `otherwise` without one. */
export function gateOf(aid: AidOut, otherwise: number): number {
  const worst = aid.innovation.reduce<number>((most, value, i) => {
    const ratio = Math.abs((value ?? NaN) / (aid.innovation_sigma[i] ?? NaN));
    return ratio > most ? ratio : most;
  }, 0);
  const gate = worst / Math.sqrt(aid.test_ratio ?? NaN);
  return gate >= 1 && gate <= 1000 ? Number(gate.toPrecision(3)) : otherwise;
}

export interface InnovationSignals {
  readonly innovation: Signal;
  readonly sigma: Signal;
  /** The innovation where it was refused for being too large, NaN where it was not. */
  readonly refused: Signal;
}

const REFUSED_GATE = 1;

/** The three curves of one component of an aid's innovation. */
export function innovationSignals(aid: string, component: number): InnovationSignals {
  const { unit, factor } = aidLook(aid);
  const n = AIDS.findIndex((each) => each === aid);
  const value = (ring: Ring, i: number): number => factor * ring.value(i, `innovation_${component}`);
  const signal = (name: string, read: Signal["read"]): Signal => ({
    id: `aids#${n}:${name}`,
    group: "aids",
    source: aid,
    topic: `aids#${n}`,
    columns: AID_COLUMNS,
    quantity: "innovation",
    unit,
    wireName: name,
    wraps: 0,
    read,
  });
  return {
    innovation: signal(`innovation_${component}`, value),
    sigma: signal(
      `sigma_${component}`,
      (ring, i) => factor * Math.sqrt(ring.value(i, `innovation_var_${component}`)),
    ),
    refused: signal(`refused_${component}`, (ring, i) =>
      ring.value(i, "status") === REFUSED_GATE ? value(ring, i) : NaN,
    ),
  };
}
