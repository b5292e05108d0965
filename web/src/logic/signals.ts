import {
  AID_COLUMNS,
  AIDS,
  LANE_COLUMNS,
  SAMPLE_COLUMNS,
  STAGE_COLUMNS,
  STEP_COLUMNS,
  type ChainSensor,
} from "../live/columns";
import type { Ring } from "../live/ring";
import { DEG, eulerFromQuat } from "./angles";
import { shown } from "./units";

export type SignalGroup = "lane" | "filtered" | "raw" | "stages" | "aids";

/** One curve a person may pick. Its identity is board-independent, so that a choice survives a change of board. */
export interface Signal {
  /** `topic:name`, e.g. "lanes/ins_ekf:roll". */
  readonly id: string;
  readonly group: SignalGroup;
  /** Lane, sensor or aid it belongs to; "" for the filtered sensors. */
  readonly source: string;
  /** Topic below `boards/{id}/`; `#n` picks the rows of one aid. */
  readonly topic: string;
  readonly columns: readonly string[];
  /** Key of its name in the catalogue (`q.…`). */
  readonly quantity: string;
  readonly unit: string;
  /** The column or columns it is made of, as named on the wire, for files. */
  readonly wireName: string;
  /** Topic of the lane it is the difference to; absent = its own value. */
  readonly against?: string;
  /** A full turn in the unit shown, where the value jumps back; 0 = it does not. */
  readonly wraps: number;
  /** How its value in the unit shown is read from row i. */
  readonly read: (ring: Ring, i: number) => number;
}

type Derived = readonly [
  quantity: string,
  unit: string,
  wraps: number,
  read: (ring: Ring, i: number) => number,
];

function euler(ring: Ring, i: number): { rollRad: number; pitchRad: number; yawRad: number } {
  return eulerFromQuat([
    ring.value(i, "q_w"),
    ring.value(i, "q_x"),
    ring.value(i, "q_y"),
    ring.value(i, "q_z"),
  ]);
}

const ATTITUDE: readonly Derived[] = [
  ["roll", "°", 360, (ring, i) => euler(ring, i).rollRad * DEG],
  ["pitch", "°", 0, (ring, i) => euler(ring, i).pitchRad * DEG],
  ["heading", "°", 360, (ring, i) => euler(ring, i).yawRad * DEG],
];
const MOTION: readonly Derived[] = [
  ["speed", "m/s", 0, (ring, i) => Math.hypot(ring.value(i, "vel_n_m_s"), ring.value(i, "vel_e_m_s"))],
  ["climb", "m/s", 0, (ring, i) => -ring.value(i, "vel_d_m_s")],
];
const PLACE: readonly Derived[] = [
  ["height", "m", 0, (ring, i) => -ring.value(i, "pos_d_m")],
  [
    "sigma_h",
    "m",
    0,
    (ring, i) => Math.hypot(ring.value(i, "sigma_pos_n_m"), ring.value(i, "sigma_pos_e_m")),
  ],
];
const FIELD: readonly Derived[] = [
  [
    "mag_norm",
    "µT",
    0,
    (ring, i) =>
      100 *
      Math.hypot(ring.value(i, "mag_x_gauss"), ring.value(i, "mag_y_gauss"), ring.value(i, "mag_z_gauss")),
  ],
];

interface Table {
  readonly group: SignalGroup;
  readonly source: string;
  readonly topic: string;
  readonly columns: readonly string[];
  readonly derived: readonly Derived[];
}

function signalsOf({ group, source, topic, columns, derived }: Table): Signal[] {
  const made = derived.map(([quantity, unit, wraps, read]) => ({
    quantity,
    unit,
    wraps,
    read,
    wireName: quantity,
  }));
  const plain = columns.map((column) => {
    const { quantity, unit, factor } = shown(column);
    const read = (ring: Ring, i: number): number => factor * ring.value(i, column);
    return { quantity, unit, wraps: 0, read, wireName: column };
  });
  return [...made, ...plain].map((each) => ({
    ...each,
    id: `${topic}:${each.wireName}`,
    group,
    source,
    topic,
    columns,
  }));
}

/** One quantity of a lane, or how far it is from another lane's. */
export function laneSignal(lane: string, wireName: string, against?: string): Signal {
  const table = { group: "lane" as const, source: lane, topic: `lanes/${lane}`, columns: LANE_COLUMNS };
  const found = signalsOf({ ...table, derived: [...ATTITUDE, ...MOTION, ...PLACE] }).find(
    (each) => each.wireName === wireName,
  );
  if (!found) throw new Error(`lanes have no ${wireName}`);
  if (against === undefined) return found;
  return { ...found, id: `${found.id}-${against}`, against: `lanes/${against}` };
}

/** Every stage of a sensor's preprocessing. */
export function stageSignals(sensor: ChainSensor): Signal[] {
  const columns = STAGE_COLUMNS[sensor];
  return signalsOf({ group: "stages", source: sensor, topic: `stages/${sensor}`, columns, derived: [] });
}

/** Columns of an aid worth a curve; the rest of its record is shown in tables. */
const AID_CURVES = new Set(["innovation_0", "innovation_1", "innovation_2", "test_ratio"]);

/** Every signal of a board that runs these lanes, in the order in which a list shows them. */
export function signalsOfBoard(lanes: readonly string[]): Signal[] {
  const laneTables = lanes.map((lane) => ({
    group: "lane" as const,
    source: lane,
    topic: `lanes/${lane}`,
    columns: LANE_COLUMNS,
    derived: [...ATTITUDE, ...MOTION, ...PLACE],
  }));
  const filtered = {
    group: "filtered" as const,
    source: "",
    topic: "filtered",
    columns: STEP_COLUMNS,
    derived: FIELD,
  };
  const raw = (["imu", "mag", "baro", "gnss", "airspeed"] as const).map((kind) => ({
    group: "raw" as const,
    source: kind,
    topic: `raw/${kind}`,
    columns: SAMPLE_COLUMNS[kind],
    derived: kind === "mag" ? FIELD : kind === "gnss" ? MOTION : [],
  }));
  const aids = AIDS.map((aid, n) => ({
    group: "aids" as const,
    source: aid,
    topic: `aids#${n}`,
    columns: AID_COLUMNS,
    derived: [],
  }));
  const aidSignals = aids.flatMap(signalsOf).filter((signal) => AID_CURVES.has(signal.wireName));
  return [...[...laneTables, filtered, ...raw].flatMap(signalsOf), ...aidSignals];
}

/** Whether every word of the query occurs somewhere in the texts. */
export function matches(query: string, ...texts: readonly string[]): boolean {
  const all = texts.join(" ").toLowerCase();
  return query
    .toLowerCase()
    .split(/\s+/)
    .every((word) => all.includes(word));
}
