import type { AidOut, HealthOut, LaneOut, LinkOut, SensorOut, Severity } from "../api/wire";

/** Barometer and GNSS may come once a second. */
const SENSOR_SILENT_S = 2.5;

export type Shape = Severity | "none";
const RANK: Readonly<Record<Severity, number>> = { ok: 0, info: 1, caution: 2, warning: 3 };

export function worst(severities: readonly Severity[]): Severity {
  return severities.reduce<Severity>((a, b) => (RANK[b] > RANK[a] ? b : a), "ok");
}

/** Gravest verdict about a subject: what its row shows. */
export function severityOf(health: HealthOut, subject: string): Severity {
  return worst(health.verdict.filter((each) => each.subject === subject).map((each) => each.severity));
}

export function linkSeverity(link: LinkOut): Severity {
  if (link.state === "open") return "ok";
  if (link.state === "opening" || link.state === "ended") return "info";
  return link.state === "silent" ? "caution" : "warning";
}

/** A lane that estimates the attitude alone does all it can; one that could do more does not. */
export function laneSeverity({ status, provides }: Pick<LaneOut, "status" | "provides">): Severity {
  if (status === "attitude" && provides === "attitude") return "ok";
  const byStatus = {
    aligning: "info",
    attitude: "caution",
    navigating: "ok",
    dead_reckoning: "caution",
    failed: "warning",
  };
  return byStatus[status] as Severity;
}

/** A sensor that was well and is silent now is not known to be well. */
export function sensorShape(health: HealthOut, sensor: SensorOut, ageS: number | null): Shape {
  const judged = severityOf(health, sensor.name);
  const silent = sensor.samples === 0 || ageS === null || ageS > SENSOR_SILENT_S;
  return silent && judged === "ok" ? "none" : judged;
}

/** Refusals that are as they should be: nothing is wrong with the sensor. */
const EXPECTED = new Set(["refused-moving", "refused-disabled", "refused-withheld", "refused-not-ready"]);

/** Aids that only apply now and then: at rest, in the air. Not hearing of them is no trouble. */
const OCCASIONAL = new Set(["zero_velocity", "zero_rate", "gravity", "sideslip", "drag"]);

/** An aid is well while it is fused now and then; a lasting refusal is for a person to look at. */
export function aidShape(aid: AidOut, ageS: number | null): Shape {
  const recent = ageS !== null && ageS <= 5;
  if (recent) return "ok";
  if (OCCASIONAL.has(aid.aid) || aid.last_status === "" || EXPECTED.has(aid.last_status.replaceAll("_", "-")))
    return "none";
  return aid.fused === 0 ? "info" : "caution";
}
