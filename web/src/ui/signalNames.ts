import { t, tMaybe } from "../i18n/index.svelte";
import type { Signal } from "../logic/signals";
import { aidName, laneName, sensorName } from "./names";

export function quantityName(signal: Signal): string {
  const aidComponent = /^innovation_(\d)$/.exec(signal.wireName);
  if (aidComponent) return `${t("q.innovation")} ${Number(aidComponent[1]) + 1}`;
  const [stage = ""] = signal.quantity.split("_");
  if (signal.group === "stages") return tMaybe(`chain.stage.${stage}`) ?? signal.wireName;
  return tMaybe(`q.${signal.quantity}`) ?? signal.wireName;
}

export function sourceName(signal: Signal): string {
  if (signal.group === "lane") return laneName(signal.source);
  if (signal.group === "filtered") return t("sensors.filtered");
  if (signal.group === "raw") return `${sensorName(signal.source)}, ${t("sensors.raw")}`;
  if (signal.group === "stages") return tMaybe(`chain.sensor.${signal.source}`) ?? signal.source;
  return aidName(signal.source);
}

/** Heading under which a list shows the signal. */
export function groupName(signal: Signal): string {
  if (signal.group === "filtered") return t("group.filtered");
  if (signal.group === "lane") return `${t("group.lane")}: ${laneName(signal.source)}`;
  if (signal.group === "raw") return `${t("group.raw")}: ${sensorName(signal.source)}`;
  return `${t("group.aids")}: ${aidName(signal.source)}`;
}
