import { STAGES, type ChainSensor, type SensorKind } from "../live/columns";
import { signalsOfBoard, stageSignals, type Signal } from "./signals";

/** One small plot of a sensor: its filtered column (if the engine makes one) in front of the raw one. */
export interface SensorChart {
  readonly name: string;
  readonly filtered: string;
  readonly raw: string;
}

function axes(stem: string, unit: string): SensorChart[] {
  return ["x", "y", "z"].map((axis) => {
    const column = `${stem}_${axis}_${unit}`;
    return { name: column, filtered: column, raw: column };
  });
}

export const SENSOR_CHARTS: Readonly<Partial<Record<SensorKind, readonly SensorChart[]>>> = {
  imu: [...axes("gyro", "rad_s"), ...axes("accel", "m_s2")],
  mag: axes("mag", "gauss"),
  baro: [
    { name: "altitude_m", filtered: "baro_alt_m", raw: "altitude_m" },
    { name: "pressure_pa", filtered: "", raw: "pressure_pa" },
  ],
  gnss: [
    { name: "speed", filtered: "", raw: "speed" },
    { name: "alt_m", filtered: "", raw: "alt_m" },
    { name: "h_acc_m", filtered: "", raw: "h_acc_m" },
  ],
  airspeed: [
    { name: "tas_m_s", filtered: "airspeed_m_s", raw: "tas_m_s" },
    { name: "diff_pressure_pa", filtered: "", raw: "diff_pressure_pa" },
  ],
};

const byId = new Map(signalsOfBoard([]).map((signal) => [signal.id, signal]));

/** Signals of a chart, filtered first; raw values are shown with the scale that was found for them. */
export function sensorSignals(
  kind: SensorKind,
  chart: SensorChart,
  scale: number,
): readonly [Signal, ...Signal[]] {
  const filtered = byId.get(`filtered:${chart.filtered}`);
  const raw = byId.get(`raw/${kind}:${chart.raw}`);
  const scaled =
    raw && kind === "mag"
      ? { ...raw, read: (...at: Parameters<Signal["read"]>) => scale * raw.read(...at) }
      : raw;
  if (!scaled) throw new Error(`no raw signal for ${kind} ${chart.raw}`);
  return filtered ? [filtered, scaled] : [scaled];
}

/** Chain that a raw column runs through, and what its stages are called there. */
const STAGED: Readonly<Record<string, readonly [ChainSensor, string]>> = {
  altitude_m: ["baro", "m"],
  diff_pressure_pa: ["airspeed", "pa"],
};

export function chainOf({ raw }: SensorChart): ChainSensor | null {
  return STAGED[raw]?.[0] ?? (/^(gyro|accel|mag)_[xyz]_/.exec(raw)?.[1] as ChainSensor | undefined) ?? null;
}

/** Stages of a chart's quantity, last first; [] where no chain touches it. */
export function chartStages(chart: SensorChart): readonly Signal[] {
  const sensor = chainOf(chart);
  if (!sensor) return [];
  const rest = STAGED[chart.raw]?.[1] ?? chart.raw.slice(sensor.length + 1);
  const all = new Map(stageSignals(sensor).map((signal) => [signal.wireName, signal]));
  return [...STAGES].reverse().flatMap((stage) => all.get(`${stage}_${rest}`) ?? []);
}
