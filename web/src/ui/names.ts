import type { AidOut, VerdictOut } from "../api/wire";
import { tMaybe } from "../i18n/index.svelte";

/** Names of things the server names by key; an unknown key is shown as it is. */
export function sensorName(name: string): string {
  return tMaybe(`sensor.${name}`) ?? name;
}

export function laneName(name: string): string {
  return tMaybe(`lane.name.${name}`) ?? name;
}

/** Names of protocols are the same in every language. */
export function protocolName(name: string): string {
  return { mavlink: "MAVLink", ubx: "UBX", nmea: "NMEA" }[name] ?? name;
}

/** Keys come with dashes or underscores. */
export function aidName(name: string): string {
  return tMaybe(`aid.${name.replaceAll("-", "_")}`) ?? name;
}

export function aidStatusName(name: string): string {
  return tMaybe(`aidStatus.${name.replaceAll("-", "_")}`) ?? name;
}

export function subjectName({ subject }: VerdictOut): string {
  if (subject.startsWith("lane:")) return laneName(subject.slice(5));
  if (subject.startsWith("aid:")) return aidName(subject.slice(4));
  return tMaybe(`subject.${subject}`) ?? tMaybe(`sensor.${subject}`) ?? subject;
}

/** Whether an aid has ever been used or refused for a reason other than being switched off. */
export function isActive(aid: AidOut): boolean {
  return aid.fused > 0 || aid.last_status !== "";
}
