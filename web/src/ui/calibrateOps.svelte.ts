import { api } from "../api/http";
import type { CalibrationWish, CalSensor, JobOut } from "../api/wire";
import { t } from "../i18n/index.svelte";
import { app } from "../live/app.svelte";
import { calibration } from "../live/calibration.svelte";
import { calSensorName } from "./calibrateNames";
import { notices } from "./notice.svelte";

/** Start a job; null = refused, and said so. */
export async function startJob(wish: CalibrationWish): Promise<JobOut | null> {
  try {
    const job = await api.startCalibration(app.boardId, wish);
    calibration.takeJob(job);
    return job;
  } catch (error) {
    notices.failed(error);
    return null;
  }
}

export async function act(job: JobOut, action: "cancel" | "confirm" | "verify"): Promise<void> {
  try {
    calibration.takeJob(await api.actOnCalibration(job, action));
  } catch (error) {
    notices.failed(error);
  }
}

/** Apply what a job found; it can be undone at once. */
export async function applyJob(job: JobOut): Promise<void> {
  try {
    calibration.takeJob(await api.actOnCalibration(job, "apply"));
    await calibration.readSets();
    sayApplied(job.sensor);
  } catch (error) {
    notices.failed(error);
  }
}

export async function applySet(sensor: CalSensor, set: string): Promise<void> {
  try {
    calibration.takeSets(await api.applySet(app.boardId, set));
    sayApplied(sensor);
  } catch (error) {
    notices.failed(error);
  }
}

/** Say that it is in force, with the way back. */
export function sayApplied(sensor: CalSensor): void {
  notices.say({
    severity: "info",
    text: t("cal.nowApplied", { sensor: calSensorName(sensor) }),
    action: { label: t("cal.rollBack"), run: () => void rollBack(sensor) },
  });
}

export async function rollBack(sensor: CalSensor): Promise<void> {
  try {
    calibration.takeSets(await api.rollBack(app.boardId, sensor));
    notices.say({ severity: "info", text: t("cal.nowRolledBack", { sensor: calSensorName(sensor) }) });
  } catch (error) {
    notices.failed(error);
  }
}

/** Taking off is undone by applying the same again. */
export async function takeOff(sensor: CalSensor, set: string): Promise<void> {
  try {
    calibration.takeSets(await api.takeOff(app.boardId, sensor));
    notices.say({
      severity: "info",
      text: t("cal.nowTakenOff", { sensor: calSensorName(sensor) }),
      action: { label: t("board.undo"), run: () => void applySet(sensor, set) },
    });
  } catch (error) {
    notices.failed(error);
  }
}

export async function deleteSet(set: string): Promise<void> {
  try {
    await api.deleteSet(app.boardId, set);
    await calibration.readSets();
    notices.say({ severity: "info", text: t("hist.deleted") });
  } catch (error) {
    notices.failed(error);
  }
}
