import type { SensorKind } from "../live/columns";
import { signalsOfBoard, type Signal } from "./signals";

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
  airspeed: [{ name: "tas_m_s", filtered: "airspeed_m_s", raw: "tas_m_s" }],
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
